"""What can be set in a robot's file, from the dataclasses and models that check it."""

from __future__ import annotations

import dataclasses
import inspect
import re
import typing
from collections.abc import Iterator
from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from typing import Any

from pydantic import BaseModel

from cli.processes import FLEET, OPTIONAL, ROBOT
from cli.robot import settings_kinds
from common.camera import StereoCamera
from common.config import BusTable, RobotTable, SecurityTable, ServerTable
from docs.drawing.markdown import inline, sentence, table
from docs.drawing.types import words

_HEAD = ("key", "takes", "default", "")
_ATTRIBUTE = re.compile(r"^ {4}(?P<names>\w+(?:, \w+)*): (?P<text>.*(?:\n {8,}.*)*)", re.MULTILINE)


@dataclass(frozen=True, slots=True)
class Setting:
    """A key of a table: its name, its type, its default, and what its class says of it."""

    name: str
    kind: Any
    default: Any
    text: str


def of_common() -> dict[str, type[Any]]:
    """The tables that belong to no service."""
    return {"robot": RobotTable, "server": ServerTable, "bus": BusTable, "security": SecurityTable}


def tables(name: str, kind: type[Any]) -> Iterator[tuple[str, str, list[Setting]]]:
    """A table and those below it: the name, what it is about, and its keys."""
    own = [one for one in _settings(kind) if _inner(one.kind) is None]
    if own:
        yield name, sentence(inspect.getdoc(kind)), own
    for one in _settings(kind):
        if (inner := _inner(one.kind)) is not None:
            yield from tables(f"{name}.{one.name}", inner)


def drawn(name: str, kind: type[Any]) -> str:
    """A table of a file and those below it, each under a heading."""
    parts = []
    for title, about, settings in tables(name, kind):
        rows = [(f"`{one.name}`", words(one.kind), default(one.default), one.text) for one in settings]
        parts.append(f"### `[{title}]`\n\n{about}\n\n{table(_HEAD, rows)}")
    return "\n".join(parts) or "Nothing can be set.\n"


def default(value: Any) -> str:
    """A default as TOML has it."""
    if value is dataclasses.MISSING:
        return "*must be given*"
    if value is None:
        return ""
    if isinstance(value, StereoCamera):
        return f"{value.width}x{value.height}, {value.baseline:g} m apart"
    return f"`{_toml(value)}`"


def _toml(value: Any) -> str:
    if isinstance(value, Enum):
        return _toml(value.value)
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str | Path):
        return f'"{value}"'
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(_toml, value))}]"
    return str(value)


def every() -> dict[str, Setting]:
    """Every key of every table, by the two's names with a dot between."""
    kinds = {**of_common(), **settings_kinds((*ROBOT, *OPTIONAL, *FLEET))}
    return {
        f"{title}.{one.name}": one
        for name, kind in kinds.items()
        for title, _, settings in tables(name, kind)
        for one in settings
    }


def _settings(kind: type[Any]) -> list[Setting]:
    said = _said(kind)
    hints = typing.get_type_hints(kind, include_extras=True)
    return [Setting(name, hints[name], value, said.get(name, "")) for name, value in _defaults(kind)]


def _defaults(kind: type[Any]) -> list[tuple[str, Any]]:
    if issubclass(kind, BaseModel):
        fields = kind.model_fields
        return [(name, dataclasses.MISSING if one.is_required() else one.default) for name, one in fields.items()]
    return [(one.name, _of_dataclass(one)) for one in dataclasses.fields(kind)]


def _of_dataclass(field: dataclasses.Field[Any]) -> Any:
    if field.default_factory is not dataclasses.MISSING:
        return field.default_factory()
    return field.default


def _said(kind: type[Any]) -> dict[str, str]:
    """What the docstrings of a class and of those that it extends say of its attributes."""
    found: dict[str, str] = {}
    for one in reversed(kind.__mro__):
        doc = inspect.cleandoc(one.__dict__.get("__doc__") or "")
        attributes = doc.partition("Attributes:\n")[2]
        for match in _ATTRIBUTE.finditer(attributes):
            text = " ".join(match["text"].split())
            for name in match["names"].split(", "):
                found[name] = inline(text[:1].upper() + text[1:])
    return found


def _inner(kind: Any) -> type[Any] | None:
    """The class of a table below, where the key is one."""
    candidates = [kind, *typing.get_args(kind)]
    for one in candidates:
        if isinstance(one, type) and dataclasses.is_dataclass(one) and one not in _VALUES:
            return one
    return None


_VALUES = {StereoCamera}
"""Dataclasses that no file can write as a table."""
