"""``vtr pause``, ``vtr resume``, ``vtr cancel``."""

from typing import Annotated

import typer

from cli.arguments import ConfigOption, JsonOption


def pause(
    *,
    at_vertex: Annotated[
        bool, typer.Option("--at-vertex", help="Let it drive on to a vertex of its route, and stop softly there.")
    ] = False,
    config: ConfigOption = None,
    as_json: JsonOption = False,
) -> None:
    """Stop the robot, keeping what it was doing."""
    from cli.operator import carry_out
    from common.messages import Command

    carry_out(config, Command(action="pause", at_vertex=at_vertex), as_json=as_json)


def resume(*, config: ConfigOption = None, as_json: JsonOption = False) -> None:
    """Go on with what was paused."""
    from cli.operator import carry_out
    from common.messages import Command

    carry_out(config, Command(action="resume"), as_json=as_json)


def cancel(
    *,
    goal: Annotated[
        int | None, typer.Option(metavar="N", min=1, help="Only the N-th of the goals that wait; the robot drives on.")
    ] = None,
    config: ConfigOption = None,
    as_json: JsonOption = False,
) -> None:
    """Stop, and forget what was being done; a map being taught is finished as it stands."""
    from cli.operator import LONG_DEADLINE_S, carry_out
    from common.messages import Command

    command = Command(action="cancel") if goal is None else Command(action="drop", number=goal)
    carry_out(config, command, as_json=as_json, deadline=LONG_DEADLINE_S)
