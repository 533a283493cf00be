"""Every command of ``vtr``, from the command line itself."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from cli.app import command_line
from docs.drawing.markdown import inline, table


def walk(command: Any = None, path: tuple[str, ...] = ("vtr",)) -> Iterator[tuple[str, Any]]:
    """Every command with its words, in the order of the help."""
    command = command_line() if command is None else command
    nested = getattr(command, "commands", None)
    if nested is None:
        yield " ".join(path), command
        return
    for name, inner in nested.items():
        yield from walk(inner, (*path, name))


def all_commands() -> str:
    """A heading, the description, and the arguments and options of every command."""
    return "\n".join(_one(words, command) for words, command in walk())


def _one(words: str, command: Any) -> str:
    rows = [(_name(one), inline(one.help or ""), _default(one)) for one in command.params if not one.hidden]
    return f"### `{words}`\n\n{inline(' '.join(command.help.split()))}\n\n" + table(("", "", "default"), rows)


def _name(parameter: Any) -> str:
    if parameter.param_type_name == "argument":
        return f"`{parameter.metavar or parameter.name.upper()}`"
    names = ", ".join(f"`{name}`" for name in (*parameter.opts, *parameter.secondary_opts))
    return f"{names} `{parameter.metavar}`" if parameter.metavar else names


def _default(parameter: Any) -> str:
    value = parameter.default
    if parameter.required:
        return "*must be given*"
    if value is None or value is False or callable(value):
        return ""
    return f"`{getattr(value, 'value', value)}`"
