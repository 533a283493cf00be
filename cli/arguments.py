"""Options and arguments that several commands share, and how their text becomes ids."""

import re
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from cli import completion
from cli.errors import CommandError

if TYPE_CHECKING:
    from common.ids import VertexId

CONFIG_HELP = "The robot's TOML file; by default ./robot.toml."

ConfigArgument = Annotated[Path | None, typer.Argument(metavar="[CONFIG]", help=CONFIG_HELP)]
ConfigOption = Annotated[Path | None, typer.Option("--config", "-c", envvar="VTR_CONFIG", help=CONFIG_HELP)]
JsonOption = Annotated[bool, typer.Option("--json", help="Print the result as JSON.")]
DetachOption = Annotated[
    bool, typer.Option("--detach", "-d", help="Return when every process is up, and leave them running.")
]
EnvironmentOption = Annotated[
    str | None,
    typer.Option(
        "--environment",
        "-e",
        metavar="NAME",
        help="The environment; by default the robot's own.",
        autocompletion=completion.environments,
    ),
]
FromOption = Annotated[
    str | None,
    typer.Option(
        "--from", metavar="MAP:INDEX", help="The vertex that the robot stands at; by default it knows, or looks."
    ),
]
StartPlaceOption = Annotated[str | None, typer.Option(metavar="NAME", help="Name of the map's first vertex.")]


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


def place(text: str | None, option: str) -> str | None:
    """The place given by an option: a name, or the vertex of an end that has none.

    Raises:
        CommandError: it is no place.
    """
    from common.ids import PLACE_PATTERN

    if text is not None and re.match(PLACE_PATTERN, text) is None:
        raise CommandError(f"{option}: '{text}' is no place: write its name, or map:index for one without")
    return text


def map_ids(texts: list[str]) -> list[str]:
    """Whole ids of maps.

    Raises:
        CommandError: one of them is none.
    """
    from common.ids import MAP_ID_PATTERN

    for text in texts:
        if re.match(MAP_ID_PATTERN, text) is None:
            raise CommandError(f"'{text}' is no map's whole id: vtr maps ls --fleet lists them")
    return list(texts)
