"""The operator at the server's side of the network: holds each robot's dead man's switch, and stops robots.

``python -m bench.bad_network.operator FOLDER`` runs until the file ``stop`` is in the folder. Who stops a robot lets go
of its switch, and repeats the order until it is answered; then it is reset and resumed.
"""

from __future__ import annotations

import sys
import threading
import time
from pathlib import Path

from bench.bad_network.agent import Log
from bench.bad_network.plan import Plan
from bench.bad_network.site import ENVIRONMENT, ROUTER
from common import topics
from common.bus import Bus
from common.environment.metadata import robot_of
from common.errors import Refused, RetraverseError
from common.messages import Catalog, CatalogQuery, Command, Joystick, Message, SafetyCommand, now_ns

_HOLD_S = 1.0 / topics.JOYSTICK.rate_hz
_ASK_S = 2.0
_REST_S = 3.0


class Hand:
    """One hand at one robot's switch and its stop button."""

    def __init__(self, robot: str, plan: Plan, log: Log, stop: threading.Event) -> None:
        self._robot, self._plan, self._log, self._stop = robot, plan, log, stop
        self._bus = Bus(robot, "operator", ROUTER, shared_memory=False)
        self._joystick = self._bus.publisher(topics.JOYSTICK)
        self._holds = True
        self._threads = [threading.Thread(target=run, daemon=True) for run in (self._hold, self._stop_at_times)]

    def start(self) -> None:
        """Holds the switch."""
        for thread in self._threads:
            thread.start()

    def end(self) -> None:
        """Lets go, and leaves the bus."""
        for thread in self._threads:
            thread.join()
        self._bus.close()

    def _hold(self) -> None:
        while not self._stop.wait(_HOLD_S):
            self._joystick.put(Joystick(stamp=now_ns(), axes=[], held=self._holds, buttons=[]))

    def _stop_at_times(self) -> None:
        for number, at in enumerate(at for at, robot in self._plan.stops if robot == self._robot):
            if self._stop.wait(max(self._plan.start + at - time.monotonic(), 0.0)):
                return
            self._holds = False
            self._log.write("stop", self._robot, number=number)
            self._until_answered(SafetyCommand(action="stop", reason=f"stop {number}"))
            self._log.write("latched", self._robot, number=number)
            if self._stop.wait(_REST_S):
                return
            self._log.write("release", self._robot, number=number)
            self._until_answered(SafetyCommand(action="reset"))
            self._log.write("reset", self._robot, number=number)
            self._holds = True
            self._until_answered(Command(action="resume"))

    def _until_answered(self, order: Message) -> None:
        topic = topics.SAFETY_COMMAND if isinstance(order, SafetyCommand) else topics.MISSION
        while not self._stop.is_set():
            try:
                self._bus.ask(topic, order, _ASK_S)
            except Refused as refusal:
                self._log.write("refused", self._robot, error=str(refusal))
            except RetraverseError:
                self._stop.wait(0.1)
                continue
            return


def main() -> None:
    """Holds, stops, and asks the server what it knows until the file ``stop`` is there."""
    folder = Path(sys.argv[1])
    plan = Plan.parse((folder / "plan.json").read_text(encoding="utf-8"))
    stop = threading.Event()
    with (folder / "operator.jsonl").open("w", encoding="utf-8") as stream:
        log = Log(stream)
        hands = [Hand(robot, plan, log, stop) for robot in plan.robots]
        for hand in hands:
            hand.start()
        with Bus("fleet", "operator", ROUTER, shared_memory=False) as bus:
            known: set[str] = set()
            while not (folder / "stop").exists():
                _ask_catalog(bus, log, known)
                time.sleep(0.5)
        stop.set()
        for hand in hands:
            hand.end()


def _ask_catalog(bus: Bus, log: Log, known: set[str]) -> None:
    """Logs each map that the server has come to know, and whether it lists any twice."""
    try:
        answer: Catalog = bus.ask(topics.CATALOG, CatalogQuery(environment=ENVIRONMENT, limit=10_000), 5.0, ENVIRONMENT)
    except RetraverseError:
        return
    names = [entry.map for entry in answer.entries]
    for name in sorted(set(names) - known):
        log.write("known", robot_of(name), map=name)
    if len(names) != len(set(names)):
        log.write("twice", "fleet", maps=names)
    known |= set(names)


if __name__ == "__main__":
    main()
