"""From goal to goal until the time is over, with a hand that kills, and an eye on memory and on the path."""

from __future__ import annotations

import contextlib
import os
import random
import signal
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

import numpy as np
import psutil

from cli.chaos import orders
from cli.chaos.orders import Order
from cli.demo.story import Story
from cli.operator import insist
from cli.soak.network import PLACES
from common import topics
from common.geometry import Array
from common.ids import VertexId
from common.messages import Command, Goal, State, StateName, now_ns

SPARED = frozenset({"sensors", "navigator"})
"""Not killed: the simulated world would end, and a navigator that is started anew waits for a person, as it should."""

_SAMPLE_S = 0.1
_PATIENCE_S = 120.0
_TAKEN_S = 60.0


@dataclass(slots=True)
class Drive:
    """What was seen: times are monotonic seconds, memory is in bytes.

    Attributes:
        truth: rows ``[x, y, follows]``, where the robot truly was ten times a second and whether it followed a route.
        goals, reached: how many it was sent to, and how many of them it got to by itself.
        interventions: why a person had to send it again.
        kills: how often each process was killed.
        stops: how often each of safety's rules stopped it while it followed a route: falsely, where nothing was killed.
        memory: of each process, in all of its lives, rows of seconds since the beginning and of what it took then.
    """

    truth: list[tuple[float, float, bool]] = field(default_factory=list)
    goals: int = 0
    reached: int = 0
    interventions: list[str] = field(default_factory=list)
    kills: dict[str, int] = field(default_factory=dict)
    stops: dict[str, int] = field(default_factory=dict)
    memory: dict[str, list[tuple[float, int]]] = field(default_factory=dict)

    def kilometres(self) -> float:
        """Driven."""
        xy = np.array([row[:2] for row in self.truth]).reshape(-1, 2)
        return float(np.linalg.norm(np.diff(xy, axis=0), axis=1).sum()) / 1e3

    def followed(self) -> Array:
        """Where it was (N, 2) while it followed a route."""
        return np.array([row[:2] for row in self.truth if row[2]]).reshape(-1, 2)


class Soak:
    """Drives a robot on a network whose ring is ``ring``; its places are the goals."""

    def __init__(self, story: Story, ring: str, *, kill_every: float, lose: float, seed: int) -> None:
        self.seen = Drive()
        self._story = story
        self._ring = ring
        self._kill_every = kill_every
        self._lose = lose
        self._chance = random.Random(seed)  # noqa: S311, chance for tests
        self._states = story.bus.subscribe(topics.STATE)
        self._truth = story.bus.subscribe(topics.TRUTH)
        self._safety = story.bus.subscribe(topics.SAFETY_STATUS)
        self._done = threading.Event()
        self._begin = 0.0

    def run(self, over: Callable[[Drive], bool]) -> Drive:
        """Drives until it is over, and then on to the goal that it is driving to."""
        configuration, self._begin = self._story.supervised.config, time.monotonic()
        orders.send(configuration, "sensors", Order(kind="lose", amount=self._lose, key="/sensor/stereo"))
        threads = [threading.Thread(target=task, daemon=True) for task in (self._look, self._kill)]
        for thread in threads:
            thread.start()
        try:
            places = self._places()
            while not over(self.seen):
                self._go(next(places))
        finally:
            self._done.set()
            for thread in threads:
                thread.join()
            orders.send(configuration, "sensors", Order(kind="none"))
        return self.seen

    # --- goals -------------------------------------------------------------------------------------------------------

    def _places(self) -> Iterator[str]:
        """All places in turn, so that every process has seen all of the network, and then any but the last one."""
        here = PLACES[0]
        yield from (*PLACES[1:], here)
        while True:
            here = self._chance.choice([place for place in PLACES if place != here])
            yield here

    def _go(self, place: str) -> None:
        """Sends the robot to a place, and again after whatever ended that otherwise."""
        self.seen.goals += 1
        first = True
        while True:
            start = None if self.seen.goals > 1 or not first else VertexId(self._ring, 0)
            self._insist(Command(action="repeat", goal=Goal(to=place, record=False), vertex=start))
            ended = self._await_end(now_ns())
            if ended.reason.startswith("reached"):
                self.seen.reached += first
                return
            self.seen.interventions.append(f"{place}: {ended.reason}")
            first = False

    def _insist(self, command: Command) -> None:
        insist(self._story.bus, command, _TAKEN_S)

    def _await_end(self, begun: int) -> State:
        """Waits until the repeat that was ``begun`` at a stamp is over; the operator ends one that pauses for long."""
        moving = time.monotonic()
        while True:
            received = self._states.wait(1.0)
            state: State | None = None if received is None else received.message
            now = time.monotonic()
            if state is None:
                continue
            if state.name is StateName.REPEAT_FOLLOW:
                moving = now
            if state.name is StateName.IDLE and state.since > begun:
                return state
            if now - moving > _PATIENCE_S:
                self._insist(Command(action="cancel"))
                return state.model_copy(
                    update={"reason": f"stood for {_PATIENCE_S:.0f} s in {state.name}: {state.reason}"}
                )

    # --- beside the drive --------------------------------------------------------------------------------------------

    def _kill(self) -> None:
        while not self._done.wait(self._kill_every):
            running = [p for p in self._story.supervised.processes() if p.pid and p.name not in SPARED]
            if running:
                victim = self._chance.choice(running)
                with contextlib.suppress(ProcessLookupError):
                    os.kill(int(victim.pid or 0), signal.SIGKILL)
                    self.seen.kills[victim.name] = self.seen.kills.get(victim.name, 0) + 1

    def _look(self) -> None:
        beats = 0
        followed: set[str] | None = None
        while not self._done.wait(_SAMPLE_S):
            truth, state = self._truth.last(), self._states.last()
            follows = state is not None and state.message.name is StateName.REPEAT_FOLLOW
            if truth is not None:
                T = truth.message.T_world_vehicle
                self.seen.truth.append((float(T[0, 3]), float(T[1, 3]), follows))
            followed = self._count_stops(followed) if follows else None
            beats += 1
            if beats % 50 == 0:
                self._weigh()

    def _count_stops(self, before: set[str] | None) -> set[str]:
        """Counts the rules that stop the robot and did not ``before``; None where it did not follow a route then."""
        status = self._safety.last()
        stopping = set() if status is None or status.message.passing else {r.rule for r in status.message.reasons}
        for rule in stopping - before if before is not None else ():
            self.seen.stops[rule] = self.seen.stops.get(rule, 0) + 1
        return stopping

    def _weigh(self) -> None:
        seconds = time.monotonic() - self._begin
        for process in self._story.supervised.processes():
            if not process.pid:
                continue
            with contextlib.suppress(psutil.Error):
                size = psutil.Process(process.pid).memory_info().rss
                self.seen.memory.setdefault(process.name, []).append((seconds, size))
