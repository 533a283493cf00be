"""The shape of an ONNX network's input, read from its file.

OpenCV's runtime neither tells it nor minds an image of another number of channels: it reads beside the array. So the
few fields of the file that hold it are read here, by the wire format of protocol buffers.
"""

from __future__ import annotations

from collections.abc import Iterator

_VARINT, _EIGHT_BYTES, _BYTES, _FOUR_BYTES = 0, 1, 2, 5

_MODEL_GRAPH = 7
_GRAPH_INITIALIZER, _GRAPH_INPUT = 5, 11
_TENSOR_NAME = 8
_VALUE_NAME, _VALUE_TYPE = 1, 2
_TYPE_TENSOR = 1
_TENSOR_SHAPE = 2
_SHAPE_DIM = 1
_DIM_VALUE = 1


def input_shape(content: bytes) -> tuple[int | None, ...]:
    """Sizes of the only input of a network, None where any will do.

    Raises:
        ValueError: the file is no ONNX network with one input.
    """
    graph = _last(content, _MODEL_GRAPH)
    weights = {_last(tensor, _TENSOR_NAME) for tensor in _all(graph, _GRAPH_INITIALIZER)}
    inputs = [value for value in _all(graph, _GRAPH_INPUT) if _last(value, _VALUE_NAME) not in weights]
    if len(inputs) != 1:
        raise ValueError(f"the network has {len(inputs)} inputs")
    shape = _last(_last(_last(inputs[0], _VALUE_TYPE), _TYPE_TENSOR), _TENSOR_SHAPE)
    return tuple(_size(dimension) for dimension in _all(shape, _SHAPE_DIM))


def _size(dimension: bytes) -> int | None:
    """A dimension that has a name instead of a size, or none of both, may have any size."""
    sizes = [value for field, value in _fields(dimension) if field == _DIM_VALUE and isinstance(value, int)]
    return sizes[-1] if sizes and sizes[-1] > 0 else None


def _all(message: bytes, number: int) -> list[bytes]:
    return [value for field, value in _fields(message) if field == number and isinstance(value, bytes)]


def _last(message: bytes, number: int) -> bytes:
    """The field's value, empty where the message has none."""
    return next(iter(_all(message, number)[::-1]), b"")


def _fields(message: bytes) -> Iterator[tuple[int, int | bytes]]:
    """Number and value of each field of a message.

    Raises:
        ValueError: it is no message.
    """
    place = 0
    while place < len(message):
        key, place = _varint(message, place)
        kind = key & 7
        if kind == _VARINT:
            value, place = _varint(message, place)
            yield key >> 3, value
            continue
        if kind == _BYTES:
            length, place = _varint(message, place)
        elif kind in {_EIGHT_BYTES, _FOUR_BYTES}:
            length = 8 if kind == _EIGHT_BYTES else 4
        else:
            raise ValueError(f"a field of the unknown kind {kind}")
        if place + length > len(message):
            raise ValueError("a field that is cut short")
        yield key >> 3, message[place : place + length]
        place += length


def _varint(message: bytes, place: int) -> tuple[int, int]:
    """A number of seven bits a byte, the lowest first, and where it ends."""
    value = 0
    for count in range(10):
        if place + count >= len(message):
            break
        byte = message[place + count]
        value |= (byte & 0x7F) << (7 * count)
        if byte < 0x80:
            return value, place + count + 1
    raise ValueError("a number without an end")
