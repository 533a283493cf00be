"""Who is there: Zenoh's liveliness tokens under ``vtr/<robot>/``.

A process shows ``alive/<process>`` from when it is ready to work; every session shows ``life/<process>/<life>``.
"""

from __future__ import annotations

import threading
import time

import zenoh

from common.bus.envelope import Source


class Presence:
    """The processes of a robot that are connected now.

    A killed process disappears within milliseconds, a frozen one only after the transport's lease: whoever depends
    on data watches the data's own deadline as well.
    """

    def __init__(self, wake: threading.Event | None = None) -> None:
        self._lock = threading.Lock()
        self._alive: dict[str, float] = {}
        self._wake = wake

    def hand_over(self, sample: zenoh.Sample) -> None:
        """Zenoh's callback: a token appeared or went."""
        process = str(sample.key_expr).rsplit("/", 1)[-1]
        with self._lock:
            if sample.kind == zenoh.SampleKind.PUT:
                self._alive[process] = time.monotonic()
            else:
                self._alive.pop(process, None)
        if self._wake is not None:
            self._wake.set()

    def __contains__(self, process: object) -> bool:
        with self._lock:
            return process in self._alive

    def alive(self) -> frozenset[str]:
        """The names of the connected processes."""
        with self._lock:
            return frozenset(self._alive)

    def since(self, process: str) -> float | None:
        """Monotonic time (s) since when a process is connected, None if it is not."""
        with self._lock:
            return self._alive.get(process)


class Lives:
    """The lives of a robot's processes that are connected now: whose samples are no recordings of an earlier one."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._alive: set[tuple[str, str]] = set()

    def hand_over(self, sample: zenoh.Sample) -> None:
        """Zenoh's callback: a token appeared or went."""
        process, life = str(sample.key_expr).rsplit("/", 2)[1:]
        with self._lock:
            if sample.kind == zenoh.SampleKind.PUT:
                self._alive.add((process, life))
            else:
                self._alive.discard((process, life))

    def __contains__(self, source: object) -> bool:
        """Whether a :class:`~common.bus.envelope.Source` is connected."""
        with self._lock:
            return isinstance(source, Source) and (source.process, source.life) in self._alive


class Robots:
    """The processes of every robot that is connected now, the fleet's server among them under its reserved name."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._alive: set[tuple[str, str]] = set()

    def hand_over(self, sample: zenoh.Sample) -> None:
        """Zenoh's callback: a token appeared or went."""
        _, robot, _, process = str(sample.key_expr).split("/")
        with self._lock:
            if sample.kind == zenoh.SampleKind.PUT:
                self._alive.add((robot, process))
            else:
                self._alive.discard((robot, process))

    def alive(self) -> dict[str, frozenset[str]]:
        """The names of the connected processes, by robot."""
        found: dict[str, set[str]] = {}
        with self._lock:
            for robot, process in self._alive:
                found.setdefault(robot, set()).add(process)
        return {robot: frozenset(processes) for robot, processes in found.items()}
