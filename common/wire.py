"""How a message becomes bytes: a msgpack header, then the raw bytes of its arrays, which are viewed and not copied.

```
0        4             8
| "VTR1" | header size | header (msgpack) | padding | array | padding | array | ...
```

An array stands in the header as an extension ``[dtype, shape, offset]``, the offset counted from the end of the
padded header. It begins at a multiple of 64 from the message's first byte, so that a view is as aligned as its message.
"""

from __future__ import annotations

import math
import struct
from functools import partial
from typing import Any, TypeVar

import msgpack
import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ValidationError

from common.arrays import DTYPES
from common.errors import MalformedMessage

_MAGIC = b"VTR1"
_PREFIX = struct.Struct("<4sI")
_ALIGN = 64
_ARRAY = 1
_MAX_DIMENSIONS = 5
_PLACE_LENGTH = 100

M = TypeVar("M", bound=BaseModel)


def encode(message: BaseModel) -> bytes:
    """The bytes of a message; each of its arrays is copied once."""
    parts: list[Any] = [b"", b""]
    end = 0

    def refer(value: object) -> msgpack.ExtType:
        nonlocal end
        if not isinstance(value, np.ndarray):
            raise TypeError(f"a message cannot carry a {type(value).__name__}")
        offset = _aligned(end)
        parts.append(bytes(offset - end))
        parts.append(np.ascontiguousarray(value))
        end = offset + value.nbytes
        return msgpack.ExtType(_ARRAY, msgpack.packb([value.dtype.str, list(value.shape), offset]))

    header = msgpack.packb(message.model_dump(mode="python"), default=refer)
    used = _PREFIX.size + len(header)
    parts[0] = _PREFIX.pack(_MAGIC, len(header))
    parts[1] = header + bytes(_aligned(used) - used)
    # One join copies every array once into memory that nobody has zeroed before.
    return b"".join(parts)


def decode(model: type[M], data: bytes | bytearray | memoryview) -> M:
    """The message of type ``model`` in ``data``; its arrays are read-only views of ``data``.

    Raises:
        MalformedMessage: the bytes are no such message, or an array reaches outside them.
    """
    view = memoryview(data).toreadonly()
    if len(view) < _PREFIX.size:
        raise MalformedMessage(f"{len(view)} bytes are too short for a message")
    magic, size = _PREFIX.unpack_from(view)
    if magic != _MAGIC or size > len(view) - _PREFIX.size:
        raise MalformedMessage("the bytes do not begin with a message's header")
    start = _aligned(_PREFIX.size + size)
    try:
        fields = msgpack.unpackb(
            view[_PREFIX.size : _PREFIX.size + size], ext_hook=partial(_view, view[start:]), strict_map_key=True
        )
        return model.model_validate(fields)
    except ValidationError as error:
        first = error.errors(include_url=False, include_input=False)[0]
        # A place may hold a stranger's text: escaped, so that it stays a part of one line of the log.
        place = ".".join(map(str, first["loc"]))[:_PLACE_LENGTH]
        raise MalformedMessage(f"not a {model.__name__}: {place!a}: {first['msg']}") from None
    except (ValueError, TypeError, RecursionError, msgpack.UnpackException) as error:
        raise MalformedMessage(f"not a {model.__name__}: {error}") from None


def _aligned(size: int) -> int:
    return -(-size // _ALIGN) * _ALIGN


def _view(body: memoryview, code: int, data: bytes) -> NDArray[Any]:
    """The array that an extension of the header refers to, in the bytes behind the header."""
    if code != _ARRAY:
        raise ValueError(f"unknown extension {code}")
    dtype, shape, offset = msgpack.unpackb(data)
    if dtype not in DTYPES or len(shape) > _MAX_DIMENSIONS:
        raise ValueError("an array of its type or number of axes cannot travel")
    if not all(type(n) is int and n >= 0 for n in (*shape, offset)):
        raise ValueError("an array's shape and offset are counts")
    if offset % _ALIGN:
        raise ValueError("an array is not aligned")
    if offset + math.prod(shape) * np.dtype(dtype).itemsize > len(body):
        raise ValueError("an array reaches outside of its message")
    return np.ndarray(tuple(shape), dtype, body, offset)
