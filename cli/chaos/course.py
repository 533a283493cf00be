"""A robot that is kept driving, by hand or by itself, so that faults can happen to it at any moment."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np

from cli.chaos.faults import Doing
from cli.demo.driver import DriverSettings
from cli.demo.errors import path_errors
from cli.demo.human import Human
from cli.demo.recorder import Recording
from cli.demo.story import Story
from cli.errors import CommandError
from cli.operator import insist
from cli.processes import ROBOT
from common import topics
from common.geometry import Array
from common.ids import VertexId
from common.messages import Command, Goal, State, StateName
from services.sensors.standing_place import StandingPlace

PROCESSES = tuple(replace(process, under="cli.chaos.process") for process in ROBOT)
"""A robot's processes, each of which obeys orders to misbehave."""

FAST_M_S = 0.8
_PACE = DriverSettings(speed=1.1, acceleration=1.0)
_POLL_S = 0.01
_STEADY_S = 0.5
_TAKEN_S = 90.0
_ROOM_M = 20.0
"""A fault needs this much of the route before its end."""


class Course:
    """A stretch of the world's route that is taught once, and then driven again and again."""

    def __init__(self, story: Story, folder: Path, metres: float) -> None:
        self.story = story
        self._place = StandingPlace(folder / "run" / "standing_place")
        self._route = _first_metres(story.route(), metres)
        self._states = story.bus.subscribe(topics.STATE)
        self.presence = story.bus.presence()
        self._safety = story.bus.subscribe(topics.SAFETY_STATUS)
        self._map = ""
        self._taught: Array = np.empty((0, 4, 4))
        self._human: Human | None = None

    def teach(self) -> None:
        """Teaches the stretch once."""
        self.story.put_down(*self._route[0])
        self._map, taught = self.story.teach(self._route, _PACE)
        self._taught = taught.poses()

    @contextmanager
    def driving(self, doing: Doing) -> Iterator[None]:
        """The robot drives fast and has room before it, by hand or by itself, and drives on after the block.

        A block that fails leaves it standing, to begin anew.
        """
        try:
            if doing == "repeat":
                self._repeat()
            else:
                self._teach()
            self._await_speed()
            yield
        except CommandError:
            self.close()
            raise

    def close(self) -> None:
        """The human lets go, and what the robot does ends."""
        self._let_go()
        self._calm()

    def resume(self) -> bool:
        """Has the operator resume what is paused; returns whether that was needed."""
        if self._state_name() is not StateName.PAUSED:
            return False
        self._persist(Command(action="resume"))
        return True

    def speed(self) -> float | None:
        """Of the simulated wheels, m/s, read beside the bus, which may be down; None where that fails."""
        state = self._place.load()
        return None if state is None else abs(state.wheel_v)

    def moves(self, speed: float) -> bool:
        """Whether the wheels are faster than this, m/s."""
        return (self.speed() or 0.0) > speed

    def offset(self, recording: Recording) -> float:
        """Farthest of the recorded drive from the taught path, metres."""
        if not recording.truth or not recording.drove():
            return 0.0
        return float(np.abs(path_errors(self._taught, recording.poses()).lateral).max())

    def await_(self, condition: Callable[[], bool], what: str, deadline: float) -> None:
        """Waits for a condition.

        Raises:
            CommandError: it does not come true within ``deadline`` seconds.
        """
        end = time.monotonic() + deadline
        while not condition():
            if time.monotonic() > end:
                raise CommandError(f"{what}: not so within {deadline:.0f} s ({self._told()})")
            time.sleep(_POLL_S)

    def _repeat(self) -> None:
        """Goes on with the present repeat if there is room, else begins another at the start."""
        if self._state_name() is StateName.REPEAT_FOLLOW and self._room() > _ROOM_M:
            return
        self.close()
        self.story.put_down(*self._route[0])
        self._persist(Command(action="repeat", goal=Goal(to="end", record=False), vertex=VertexId(self._map, 0)))

    def _teach(self) -> None:
        """Goes on with the present teach if there is room, else begins another at the start."""
        if self._human and self._state_name() is StateName.TEACH_BRANCH and self._room() > _ROOM_M:
            return
        self.close()
        self.story.put_down(*self._route[0])
        self._persist(Command(action="teach", environment=f"chaos-{time.monotonic_ns() % 10**9}"))
        self._human = Human(self.story.bus, self._route, _PACE)

    def _await_speed(self) -> None:
        """Waits until the robot has driven fast for a while: what an earlier fault has left behind is over then."""
        slow = time.monotonic()

        def steady() -> bool:
            nonlocal slow
            if not self.moves(FAST_M_S):
                slow = time.monotonic()
            return time.monotonic() - slow > _STEADY_S

        self.await_(steady, "the robot drives", 30.0)

    def _let_go(self) -> None:
        if self._human is not None:
            self._human.stop()
            self._human = None

    def _calm(self) -> None:
        if self._state_name() is not StateName.IDLE:
            self._persist(Command(action="cancel"))
        self.await_(lambda: self._state_name() is StateName.IDLE, "the robot is idle", 60.0)
        self.await_(lambda: not self.moves(0.02), "the robot stands", 10.0)

    def _persist(self, command: Command) -> None:
        insist(self.story.bus, command, _TAKEN_S)

    def _room(self) -> float:
        state = self._place.load()
        here = np.inf if state is None else np.hypot(self._route[:, 0] - state.x, self._route[:, 1] - state.y)
        steps = np.linalg.norm(np.diff(self._route[:, :2], axis=0), axis=1)
        return float(steps[int(np.argmin(here)) :].sum())

    def _told(self) -> str:
        """What the navigator and safety say."""
        state, status = self._state(), self._safety.last()
        told = "no state" if state is None else f"{state.name}, {state.reason}"
        reasons = [] if status is None else [reason.text for reason in status.message.reasons]
        return f"{told}; {' '.join(reasons) or 'safety lets commands pass'}"

    def _state(self) -> State | None:
        received = self._states.last()
        return None if received is None else received.message

    def _state_name(self) -> StateName | None:
        state = self._state()
        return None if state is None else state.name


def _first_metres(route: Array, metres: float) -> Array:
    steps = np.linalg.norm(np.diff(route[:, :2], axis=0), axis=1)
    return route[: int(np.searchsorted(np.cumsum(steps), metres)) + 2]
