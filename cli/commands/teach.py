"""``vtr teach``."""

from typing import Annotated

import typer

from cli import arguments
from cli.arguments import ConfigOption, EnvironmentOption, JsonOption
from cli.errors import CommandError


def teach(
    *,
    finish: Annotated[bool, typer.Option("--finish", help="End the map being taught, at the robot's place.")] = False,
    start_place: Annotated[str | None, typer.Option(metavar="NAME", help="Name of the map's first vertex.")] = None,
    end_place: Annotated[
        str | None, typer.Option(metavar="NAME", help="Name of the map's last vertex, with --finish.")
    ] = None,
    vertex: Annotated[
        str | None,
        typer.Option(
            "--from", metavar="MAP:INDEX", help="The vertex that the robot stands at; by default it knows, or looks."
        ),
    ] = None,
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
    command = Command(
        action="finish" if finish else "teach",
        environment=arguments.name(environment, "--environment"),
        vertex=arguments.vertex_id(vertex, "--from"),
        start_place=arguments.name(start_place, "--start-place"),
        end_place=arguments.name(end_place, "--end-place"),
    )
    carry_out(config, command, as_json=as_json, deadline=LONG_DEADLINE_S)
