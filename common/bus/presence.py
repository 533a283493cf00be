"""Who is there: Zenoh's liveliness tokens under ``vtr/<robot>/alive/<process>``."""

from __future__ import annotations

import threading
import time

import zenoh


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
