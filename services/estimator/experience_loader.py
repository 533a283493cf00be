"""Fetches the pose graph when a route begins, and lays the recorded experiences beside it, off the frame's path."""

from __future__ import annotations

import queue
import threading
from collections.abc import Callable, Sequence
from typing import NamedTuple

import structlog

from common.errors import BusError, GraphError
from common.geometry import Array
from common.ids import VertexId
from common.messages import Topology
from common.posegraph import from_topology
from services.estimator.experiences import ExperienceSettings, RouteExperiences

log = structlog.get_logger()

_IDLE_S = 0.2
_RETRY_S = 0.5


class _Wish(NamedTuple):
    environment: str
    vertices: Sequence[VertexId]
    path: Array
    use: Callable[[RouteExperiences], None]


class ExperienceLoader:
    """Loads the experiences of the newest route, in a thread of its own; ``topology`` asks the map store.

    Attributes:
        loading: whether a wish has not been met yet.
    """

    def __init__(self, topology: Callable[[str], Topology], settings: ExperienceSettings) -> None:
        self._topology = topology
        self._settings = settings
        self._wishes: queue.SimpleQueue[_Wish] = queue.SimpleQueue()
        self.loading = False

    def load(
        self, environment: str, vertices: Sequence[VertexId], path: Array, use: Callable[[RouteExperiences], None]
    ) -> None:
        """Asks for the experiences beside a route; ``use`` is called with them in the loader's thread."""
        if self._settings.most > 0:
            self.loading = True
            self._wishes.put(_Wish(environment, vertices, path, use))

    def run(self, stop: threading.Event) -> None:
        """Loads until the service stops."""
        wish: _Wish | None = None
        while not stop.is_set():
            try:
                wish = self._wishes.get(timeout=_IDLE_S)
            except queue.Empty:
                if wish is None:
                    continue
            if self._load(wish):
                wish = None
                self.loading = not self._wishes.empty()
            else:
                stop.wait(_RETRY_S)

    def _load(self, wish: _Wish) -> bool:
        """Whether that is done; a store that is away is asked again."""
        try:
            graph = from_topology(self._topology(wish.environment))
            experiences = RouteExperiences(graph, wish.vertices, wish.path, self._settings)
        except BusError:
            return False
        except GraphError as error:
            log.warning("the recorded experiences cannot be used", reason=str(error))
            return True
        if experiences.stamps:
            log.info("experiences beside the route", maps=len(experiences.stamps))
        wish.use(experiences)
        return True
