"""``vtr position``."""

from typing import Annotated

import typer

from cli import arguments
from cli.arguments import ConfigOption, EnvironmentOption, JsonOption
from cli.errors import CommandError


def position(
    vertex: Annotated[
        str | None, typer.Argument(metavar="MAP:INDEX", help="The vertex that the robot stands at.")
    ] = None,
    *,
    find: Annotated[
        bool, typer.Option("--find", help="Have the robot look for itself among all vertices of the environment.")
    ] = False,
    environment: EnvironmentOption = None,
    config: ConfigOption = None,
    as_json: JsonOption = False,
) -> None:
    """Tell the robot where it stands, or have it find out."""
    from cli.operator import LONG_DEADLINE_S, carry_out
    from common.messages import Command

    if (vertex is None) != find:
        raise CommandError("name the vertex that the robot stands at as map:index, or give --find, and not both")
    command = Command(
        action="position",
        environment=arguments.name(environment, "--environment"),
        vertex=arguments.vertex_id(vertex, "MAP:INDEX"),
        find=find,
    )
    carry_out(config, command, as_json=as_json, deadline=LONG_DEADLINE_S)
