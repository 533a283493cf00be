"""``vtr teach``."""

import sys
from typing import Annotated

import typer

from cli import arguments
from cli.arguments import ConfigOption, EnvironmentOption, FromOption, JsonOption, StartPlaceOption
from cli.errors import CommandError


def teach(
    *,
    finish: Annotated[bool, typer.Option("--finish", help="End the map being taught, at the robot's place.")] = False,
    start_place: StartPlaceOption = None,
    end_place: Annotated[
        str | None, typer.Option(metavar="NAME", help="Name of the map's last vertex, with --finish.")
    ] = None,
    vertex: FromOption = None,
    environment: EnvironmentOption = None,
    config: ConfigOption = None,
    as_json: JsonOption = False,
) -> None:
    """Begin to teach a map: the operator drives, the robot remembers; --finish ends it."""
    from cli.operator import LONG_DEADLINE_S, carry_out
    from common.messages import Command

    if end_place is not None and not finish:
        raise CommandError("--end-place names where a map ends: give it with --finish")
    if finish and (vertex is not None or environment is not None):
        raise CommandError("--finish ends the map being taught: --from and --environment belong to its beginning")
    if not as_json:
        if finish:
            end_place = _asked(end_place, "where does the map end? (empty: no name)")
        else:
            start_place = _asked(start_place, "where does the map start? (empty: the place that the robot stands at)")
    command = Command(
        action="finish" if finish else "teach",
        environment=arguments.name(environment, "--environment"),
        vertex=arguments.vertex_id(vertex, "--from"),
        start_place=arguments.name(start_place, "--start-place"),
        end_place=arguments.name(end_place, "--end-place"),
    )
    carry_out(config, command, as_json=as_json, deadline=LONG_DEADLINE_S)


def _asked(place: str | None, question: str) -> str | None:
    """The place that an option names, else the one that a person at a terminal does."""
    if place is not None or not (sys.stdin.isatty() and sys.stderr.isatty()):
        return place
    return typer.prompt(question, default="", show_default=False, err=True).strip() or None
