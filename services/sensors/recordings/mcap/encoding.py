"""Our own messages in MCAP: JSON, or msgpack where arrays make up the message.

Both have a JSON schema that is derived from the message's model. In JSON an array is nested lists, and every float
has the digits that bring it back to the last bit. In msgpack an array is ``{"dtype", "shape", "data"}``: numpy's
name of the elements, and their bytes in C order.
"""

from __future__ import annotations

import json
import math
from functools import cache
from typing import Any

import msgpack
import numpy as np
from numpy.typing import NDArray

from common.arrays import DTYPES
from common.errors import MalformedMessage
from common.messages import CameraFrame, LidarScan, Message, StereoFrame

SCHEMA_ENCODING = "jsonschema"
JSON, MSGPACK = "json", "msgpack"

_FRAMES = (StereoFrame, CameraFrame, LidarScan)
"""Megabytes of numbers, which JSON would make several times as long and slow."""

_FIRST_BUFFER = 1 << 22
_ARRAY_KEYS = {"dtype", "shape", "data"}
_DEFINITIONS = "#/$defs/"


def encoding_of(model: type[Message]) -> str:
    """MCAP's name of the encoding that messages of a model have."""
    return MSGPACK if model in _FRAMES else JSON


def schema_name(model: type[Message]) -> str:
    """The name of a model's schema."""
    return f"retraverse.{model.__name__}"


@cache
def schema_of(model: type[Message]) -> bytes:
    """The JSON schema of a model's messages as they are encoded; it refers to nothing outside of itself or within."""
    made = model.model_json_schema(mode="serialization")
    definitions = made.pop("$defs", {})
    return json.dumps(_plain(made, definitions, binary=encoding_of(model) == MSGPACK)).encode()


class Encoder:
    """Encodes messages one after another, in a buffer that is kept."""

    def __init__(self) -> None:
        self._packer = msgpack.Packer(default=_as_map, autoreset=False, buf_size=_FIRST_BUFFER)

    def encode(self, message: Message) -> bytes:
        """The bytes of a message."""
        if encoding_of(type(message)) == JSON:
            return message.model_dump_json().encode()
        self._packer.reset()
        self._packer.pack(message.model_dump(mode="python"))
        return bytes(self._packer.bytes())


def decode(model: type[Message], data: bytes) -> Message:
    """The message in the bytes.

    Raises:
        MalformedMessage: they are none of this model.
    """
    try:
        if encoding_of(model) == JSON:
            return model.model_validate_json(data)
        return model.model_validate(msgpack.unpackb(data, object_hook=_as_array))
    except (ValueError, TypeError, RecursionError, msgpack.UnpackException) as error:
        reason = " ".join(str(error).split())[:200]
        raise MalformedMessage(f"not a {model.__name__}: {reason}") from None


def _as_map(value: object) -> dict[str, Any]:
    if not isinstance(value, np.ndarray):
        raise TypeError(f"a message cannot carry a {type(value).__name__}")
    whole = np.ascontiguousarray(value)
    return {"dtype": value.dtype.str, "shape": list(value.shape), "data": whole.data.cast("B")}


def _as_array(fields: dict[str, Any]) -> dict[str, Any] | NDArray[Any]:
    if fields.keys() != _ARRAY_KEYS:
        return fields
    dtype, shape, data = fields["dtype"], fields["shape"], fields["data"]
    if dtype not in DTYPES or not isinstance(data, bytes) or not all(type(n) is int and n >= 0 for n in shape):
        raise ValueError("an array cannot be read")
    if math.prod(shape) * np.dtype(dtype).itemsize != len(data):
        raise ValueError("an array's bytes do not fit its shape")
    return np.frombuffer(data, dtype).reshape(shape)


def _plain(node: Any, definitions: dict[str, Any], *, binary: bool) -> Any:  # noqa: ANN401, whatever a schema holds
    """A schema with its references replaced by what they name, for readers that follow none."""
    if isinstance(node, list):
        return [_plain(item, definitions, binary=binary) for item in node]
    if not isinstance(node, dict):
        return node
    if "$ref" in node:
        return _plain(definitions[node["$ref"].removeprefix(_DEFINITIONS)], definitions, binary=binary)
    if binary and "dtype" in node:
        return _binary_array(node["dtype"])
    return {key: _plain(value, definitions, binary=binary) for key, value in node.items()}


def _binary_array(dtype: str) -> dict[str, Any]:
    elements = sorted(DTYPES) if dtype == "any" else [dtype]
    return {
        "type": "object",
        "properties": {
            "dtype": {"type": "string", "enum": elements},
            "shape": {"type": "array", "items": {"type": "integer", "minimum": 0}},
            "data": {"type": "string", "contentEncoding": "binary"},
        },
        "required": sorted(_ARRAY_KEYS),
    }
