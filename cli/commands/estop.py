"""``vtr estop``."""

from typing import Annotated

import typer

from cli.arguments import ConfigOption, JsonOption


def estop(
    *,
    reset: Annotated[bool, typer.Option("--reset", help="Release the latch; the robot does not move by that.")] = False,
    config: ConfigOption = None,
    as_json: JsonOption = False,
) -> None:
    """Stop the robot at once and latch it; goes straight to safety, past every other process."""
    from cli import client, robot
    from cli.output import emit
    from common import topics
    from common.messages import SafetyCommand

    command = SafetyCommand(action="reset" if reset else "stop", reason="vtr estop")
    with client.connect(robot.load(config)) as bus:
        answer = bus.ask(topics.SAFETY_COMMAND, command, timeout=2.0)
    text = answer.text or ("the emergency stop is released" if reset else "the emergency stop is latched")
    emit({"action": command.action, "text": text}, text, as_json=as_json)
