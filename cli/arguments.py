"""Options and arguments that several commands share, and how their text becomes ids."""

import re
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from cli.errors import CommandError

if TYPE_CHECKING:
    from common.ids import VertexId

CONFIG_HELP = "The robot's TOML file; by default ./robot.toml."

ConfigArgument = Annotated[Path | None, typer.Argument(envvar="VTR_CONFIG", metavar="CONFIG", help=CONFIG_HELP)]
ConfigOption = Annotated[Path | None, typer.Option("--config", "-c", envvar="VTR_CONFIG", help=CONFIG_HELP)]
JsonOption = Annotated[bool, typer.Option("--json", help="Print the result as JSON.")]
EnvironmentOption = Annotated[
    str | None, typer.Option("--environment", "-e", metavar="NAME", help="The environment; by default the robot's own.")
]


def vertex_id(text: str | None, option: str) -> "VertexId | None":
    """The vertex named by an option.

    Raises:
        CommandError: it is not written as ``map:index``.
    """
    from common.ids import VertexId

    if text is None:
        return None
    try:
        return VertexId.parse(text)
    except ValueError as error:
        raise CommandError(f"{option}: {error}") from None


def name(text: str | None, option: str) -> str | None:
    """The name of a place or an environment given by an option.

    Raises:
        CommandError: it is no name.
    """
    from common.ids import NAME_PATTERN

    if text is not None and re.match(NAME_PATTERN, text) is None:
        raise CommandError(f"{option}: '{text}' is no name: use a-z, 0-9, '-' and '_', at most 63 of them")
    return text
