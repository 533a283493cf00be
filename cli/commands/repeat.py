"""``vtr repeat``."""

from typing import Annotated

import typer

from cli import arguments
from cli.arguments import ConfigOption, EnvironmentOption, JsonOption
from cli.errors import CommandError


def repeat(
    goal: Annotated[str, typer.Argument(help="A named place, a map's id (its end), or a vertex as map:index.")],
    *,
    vertex: Annotated[
        str | None,
        typer.Option(
            "--from", metavar="MAP:INDEX", help="The vertex that the robot stands at; by default it knows, or looks."
        ),
    ] = None,
    record: Annotated[
        bool | None,
        typer.Option(
            "--record/--no-record", help="Record an experience on the way; by default as the robot is configured."
        ),
    ] = None,
    wait: Annotated[bool, typer.Option("--wait", help="Return when the robot is there, or say why not.")] = False,
    environment: EnvironmentOption = None,
    config: ConfigOption = None,
    as_json: JsonOption = False,
) -> None:
    """Drive to a goal over taught maps, by sight."""
    from cli import client, robot
    from cli.operator import LONG_DEADLINE_S, order, report
    from cli.waiting import RepeatWatch
    from common.messages import Command

    command = Command(
        action="repeat",
        goal=goal,
        environment=arguments.name(environment, "--environment"),
        vertex=arguments.vertex_id(vertex, "--from"),
        record=record,
    )
    with client.connect(robot.load(config)) as bus:
        watch = RepeatWatch(bus)
        answer = order(bus, command, LONG_DEADLINE_S)
        if wait:
            try:
                answer = watch.until_done()
            except KeyboardInterrupt:
                raise CommandError("no longer waiting, and the robot drives on: vtr pause stops it") from None
        report(answer, command, as_json=as_json)
