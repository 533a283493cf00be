"""Asks the map store for the graph, beside the loop that shows it, and the less often the longer that takes."""

from __future__ import annotations

import queue
import threading
import time

import structlog

from common import topics
from common.bus import Bus
from common.errors import RetraverseError
from common.messages import GraphQuery, Topology
from services.console.robot.models.graph import Drawn

_ASK_S = 10.0
_PERIOD_S = 3.0
_SHARE = 0.01
"""Of the time, at most, the map store is busy with the console's questions when nothing has changed."""

_EAGER = 0.1
_LONGEST_S = 120.0

log = structlog.get_logger()


class GraphFetcher:
    """Fetches an environment's topology again and again; ``wake`` says that it has changed."""

    def __init__(self, bus: Bus) -> None:
        self._bus = bus
        self._changed = threading.Event()
        self._environment = ""
        self._fetched: queue.SimpleQueue[Drawn] = queue.SimpleQueue()

    def wake(self) -> None:
        """Fetches soon."""
        self._changed.set()

    def look_at(self, environment: str) -> None:
        """Which environment is shown."""
        if environment != self._environment:
            self._environment = environment
            self.wake()

    def newest(self) -> Drawn | None:
        """What has come since the last call."""
        drawn = None
        while True:
            try:
                drawn = self._fetched.get_nowait()
            except queue.Empty:
                return drawn

    def run(self, stop: threading.Event) -> None:
        """Fetches until ``stop`` is set."""
        while not stop.is_set():
            began = time.monotonic()
            took = self._fetch() if self._environment else 0.0
            self._wait(began, took, stop)

    def _fetch(self) -> float:
        """One topology; the seconds that it took."""
        began = time.monotonic()
        try:
            topology: Topology = self._bus.ask(
                topics.TOPOLOGY, GraphQuery(environment=self._environment), timeout=_ASK_S
            )
            drawn = Drawn.of(topology, began)
        except (RetraverseError, ValueError, IndexError) as error:
            log.debug("no graph to show", reason=str(error))
            return 0.0
        self._fetched.put(drawn)
        return drawn.seconds

    def _wait(self, began: float, took: float, stop: threading.Event) -> None:
        """Until the graph has changed, but not at once where that is dear, or until it is time anyway."""
        soonest = began + max(took / _EAGER, 0.5)
        latest = began + min(max(took / _SHARE, _PERIOD_S), _LONGEST_S)
        while not stop.is_set():
            now = time.monotonic()
            if now >= latest or (now >= soonest and self._changed.is_set()):
                break
            stop.wait(0.1)
        self._changed.clear()
