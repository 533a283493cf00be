"""An operator's orders to the navigator, and the answer that a command prints."""

from __future__ import annotations

from pathlib import Path

from cli import client, robot
from cli.output import emit
from common import topics
from common.bus import Bus
from common.messages import Command, Done

DEADLINE_S = 5.0
LONG_DEADLINE_S = 20.0
"""For orders that the navigator answers only when something is stored, planned, or found."""


def order(bus: Bus, command: Command, deadline: float = DEADLINE_S) -> Done:
    """Sends an order to the navigator and returns its answer.

    Raises:
        Refused: the navigator's own sentence.
        NoAnswer: it does not answer within ``deadline`` seconds.
    """
    answer: Done = bus.ask(topics.MISSION, command, timeout=deadline)
    return answer


def carry_out(config: Path | None, command: Command, *, as_json: bool, deadline: float = DEADLINE_S) -> None:
    """Sends one order to the robot and prints the answer."""
    with client.connect(robot.load(config)) as bus:
        report(order(bus, command, deadline), command, as_json=as_json)


def report(answer: Done, command: Command, *, as_json: bool) -> None:
    """Prints the answer to an order."""
    emit({"action": command.action, "text": answer.text}, answer.text or f"{command.action}: done", as_json=as_json)
