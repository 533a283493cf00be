"""One fault in a driving robot, and what came of it."""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import signal
import threading
import time
from collections.abc import Iterator
from typing import Self

import numpy as np
import psutil

from cli.chaos import orders
from cli.chaos.course import FAST_M_S, Course
from cli.chaos.faults import Doing, Fault
from cli.chaos.judge import RECOVERS_S, Outcome, Track, judge
from cli.chaos.orders import Order
from cli.demo.recorder import Recorder
from cli.errors import CommandError
from cli.supervision.supervised import Supervised
from common import topics

_BRAKING_S = 0.45
"""From full speed to standstill: 0.3 s of safety's ramp, and the base's delay (0.06 s) and lag behind it."""
_HOGS = 4
_PERIOD_S = 0.002
_PRESENT_S = 90.0


def run(course: Course, supervised: Supervised, fault: Fault, doing: Doing) -> Outcome:
    """Lets a fault happen while the robot drives, and waits until it drives again."""
    with course.driving(doing):
        recorder = Recorder(course.story.bus)
        pid = _pid(supervised, fault.victim) if fault.victim else 0
        try:
            with Watch(course) as watch:
                begun = time.monotonic()
                with _happening(supervised, fault):
                    if fault.how == "kill":
                        # What is dead stops being dead when the supervisor has started it anew.
                        _await_anew(course, supervised, fault.victim, pid, begun)
                    else:
                        time.sleep(fault.seconds)
                ended = watch.now()
                if fault.how == "kill":
                    _await_presence(course, fault.victim, begun)
                resumed = _await_motion(course)
        finally:
            recording = recorder.stop()
        track = watch.track(course.offset(recording) if doing == "repeat" else 0.0)
    return judge(fault, doing, track, ended, _BRAKING_S, resumed=resumed)


class Watch:
    """Looks at the wheels and at ``command/safe`` five hundred times a second; a context manager."""

    def __init__(self, course: Course) -> None:
        self._course = course
        self._safe = course.story.bus.subscribe(topics.SAFE)
        self._begin = time.monotonic()
        self._wheels: list[tuple[float, float]] = []
        self._commands: list[tuple[float, float]] = []
        self._done = threading.Event()
        self._thread = threading.Thread(target=self._look, name="watch", daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_error: object) -> None:
        self._done.set()
        self._thread.join()
        self._safe.close()

    def now(self) -> float:
        """Seconds since the watch began."""
        return time.monotonic() - self._begin

    def track(self, offset: float) -> Track:
        """What was seen."""
        times, speed = np.array(self._wheels).reshape(-1, 2).T
        safe_times, safe = np.array(self._commands).reshape(-1, 2).T
        return Track(times, speed, safe_times, safe, offset)

    def _look(self) -> None:
        while not self._done.wait(_PERIOD_S):
            if (speed := self._course.speed()) is not None:
                self._wheels.append((self.now(), speed))
            while (received := self._safe.poll()) is not None:
                self._commands.append((received.arrival - self._begin, received.message.v))


@contextlib.contextmanager
def _happening(supervised: Supervised, fault: Fault) -> Iterator[None]:
    """The fault, for the length of the block; a killed process is gone from its beginning on."""
    match fault.how:
        case "kill":
            os.kill(_pid(supervised, fault.victim), signal.SIGKILL)
            yield
        case "stop":
            pid = _pid(supervised, fault.victim)
            os.kill(pid, signal.SIGSTOP)
            try:
                yield
            finally:
                os.kill(pid, signal.SIGCONT)
        case "hog":
            with _hogs():
                yield
        case _:
            orders.send(supervised.config, fault.victim, Order(kind=fault.how, amount=fault.amount, key=fault.key))
            try:
                yield
            finally:
                orders.send(supervised.config, fault.victim, Order(kind="none"))


@contextlib.contextmanager
def _hogs() -> Iterator[None]:
    """Processes that do nothing but take processors' time."""
    hogs = [multiprocessing.Process(target=_spin, daemon=True) for _ in range(_HOGS)]
    for hog in hogs:
        hog.start()
    try:
        yield
    finally:
        for hog in hogs:
            hog.kill()
            hog.join()


def _spin() -> None:
    while True:
        pass


def _pid(supervised: Supervised, process: str) -> int:
    for state in supervised.processes():
        if state.name == process and state.pid:
            return state.pid
    raise CommandError(f"'{process}' does not run")


def _await_anew(course: Course, supervised: Supervised, process: str, old_pid: int, killed: float) -> None:
    """Waits until a process that was ``killed`` at a monotonic time is there again, as another one.

    A router is there when it listens: others may find it before the link of this command does.
    """

    def anew() -> bool:
        pid = next((s.pid for s in supervised.processes() if s.name == process), 0)
        if pid in {0, None, old_pid}:
            return False
        return _listens(int(pid or 0)) if process == "router" else _is_present(course, process, killed)

    course.await_(anew, f"{process} is back", _PRESENT_S)


def _await_presence(course: Course, process: str, killed: float) -> None:
    """Waits until this command hears of a killed process again, and so of what the robot does."""
    course.await_(lambda: _is_present(course, process, killed), f"{process} is heard of", _PRESENT_S)


def _is_present(course: Course, process: str, killed: float) -> bool:
    return (course.presence.since(process) or 0.0) > killed


def _listens(pid: int) -> bool:
    try:
        return any(each.status == psutil.CONN_LISTEN for each in psutil.Process(pid).net_connections())
    except psutil.Error:
        return False


def _await_motion(course: Course) -> bool:
    """Waits until the robot drives again; returns whether an operator had to resume it."""
    with contextlib.suppress(CommandError):
        course.await_(lambda: course.moves(FAST_M_S / 2), "the robot drives again", RECOVERS_S + 1.0)
        return False
    resumed = course.resume()
    with contextlib.suppress(CommandError):
        course.await_(lambda: course.moves(FAST_M_S / 2), "the robot drives again", 15.0)
    return resumed
