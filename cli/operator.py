"""An operator's orders to the navigator, and the answer that a command prints."""

from __future__ import annotations

import time
from pathlib import Path

from cli import client, robot
from cli.errors import CommandError
from cli.output import emit
from common import topics
from common.bus import Bus
from common.errors import RetraverseError
from common.messages import Command, Done

DEADLINE_S = 5.0
LONG_DEADLINE_S = 20.0
"""For orders that the navigator answers only when something is stored, planned, or found."""
_AGAIN_S = 0.1


def order(bus: Bus, command: Command, deadline: float = DEADLINE_S) -> Done:
    """Sends an order to the navigator and returns its answer.

    Raises:
        Refused: the navigator's own sentence.
        NoAnswer: it does not answer within ``deadline`` seconds.
    """
    answer: Done = bus.ask(topics.MISSION, command, timeout=deadline)
    return answer


def insist(bus: Bus, command: Command, patience: float) -> None:
    """Gives an order until it is taken: a process that is coming back may refuse it or not answer yet.

    Raises:
        CommandError: it is not taken within ``patience`` seconds.
    """
    end = time.monotonic() + patience
    while True:
        try:
            order(bus, command, LONG_DEADLINE_S)
        except RetraverseError as error:
            if time.monotonic() > end:
                raise CommandError(f"the command to {command.action} is not taken: {error}") from None
            time.sleep(_AGAIN_S)
        else:
            return


def carry_out(config: Path | None, command: Command, *, as_json: bool, deadline: float = DEADLINE_S) -> None:
    """Sends one order to the robot and prints the answer."""
    with client.connect(robot.load(config)) as bus:
        report(order(bus, command, deadline), command, as_json=as_json)


def report(answer: Done, command: Command, *, as_json: bool) -> None:
    """Prints the answer to an order."""
    emit({"action": command.action, "text": answer.text}, answer.text or f"{command.action}: done", as_json=as_json)
