"""Types and their bounds in words."""

from __future__ import annotations

import enum
import types
import typing
from pathlib import Path
from typing import Any

import annotated_types as bounds
from pydantic import BaseModel, StringConstraints

from common import arrays
from common import messages as m
from common.ids import VertexId

_WORDS = {bool: "true or false", int: "integer", float: "number", str: "text", Path: "path", type(None): "nothing"}
_NAMED: tuple[tuple[Any, str], ...] = (
    (m.Stamp, "stamp, ns"),
    (m.Name, "name"),
    (m.PlaceName, "place"),
    (m.MapId, "map id"),
    (m.Text, "text"),
    (m.Count, "count"),
    (m.NotNegative, "number ≥ 0"),
    (m.Weight, "number"),
    (VertexId, "vertex, `map:index`"),
    (arrays.AnyArray, "array"),
    (arrays.Image, "image"),
    (arrays.Indices, "array of integers"),
)
"""Types that have a name of their own in the code."""
_SIGNS = {bounds.Ge: "≥", bounds.Gt: ">", bounds.Le: "≤", bounds.Lt: "<"}


def words(kind: Any) -> str:
    """A type as a reader of a table takes it."""
    named = next((name for known, name in _NAMED if kind == known), None)
    if named is not None:
        return named
    if typing.get_origin(kind) is not None:
        return _generic(kind, typing.get_origin(kind), typing.get_args(kind))
    if isinstance(kind, type) and issubclass(kind, enum.Enum):
        return ", ".join(f"`{one.value}`" for one in kind)
    if isinstance(kind, type) and issubclass(kind, BaseModel):
        return f"[{kind.__name__}](#{kind.__name__.lower()})"
    return _WORDS.get(kind, getattr(kind, "__name__", str(kind)))


def _generic(kind: Any, origin: Any, arguments: tuple[Any, ...]) -> str:
    if origin is typing.Annotated:
        return _annotated(kind)
    if origin is typing.Literal:
        return ", ".join(f"`{one}`" for one in arguments)
    if origin in (types.UnionType, typing.Union):
        some = " or ".join(words(one) for one in arguments if one is not type(None))
        return f"{some}, or nothing" if type(None) in arguments else some
    return _container(origin, arguments)


def _annotated(kind: Any) -> str:
    inner, *metadata = typing.get_args(kind)
    shape = next((one for one in metadata if isinstance(getattr(one, "shape", None), tuple)), None)
    text = words(inner) if shape is None else f"array {_shape(shape.shape)}"
    flat = [piece for one in metadata for piece in getattr(one, "metadata", [one])]
    limits = [f"{_SIGNS[type(one)]} {_number(one)}" for one in flat if type(one) in _SIGNS]
    lengths = [f"at most {one.max_length}" for one in flat if isinstance(one, bounds.MaxLen)]
    lengths += [
        f"at most {one.max_length} long" for one in flat if isinstance(one, StringConstraints) and one.max_length
    ]
    more = limits + lengths
    return text + (f" {', '.join(more)}" if more else "")


def _shape(shape: tuple[Any, ...]) -> str:
    return "x".join("N" if one is None else str(one) for one in shape)


def _number(bound: Any) -> str:
    value = next(getattr(bound, name) for name in ("ge", "gt", "le", "lt") if hasattr(bound, name))
    return f"{value:g}" if isinstance(value, float) else str(value)


def _container(origin: Any, arguments: tuple[Any, ...]) -> str:
    if origin is dict:
        return f"{words(arguments[1])} by {words(arguments[0])}"
    if origin is tuple and Ellipsis not in arguments:
        return f"[{', '.join(words(one) for one in arguments)}]"
    return f"list of {words(arguments[0])}" if arguments else "list"
