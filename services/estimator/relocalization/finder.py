"""The estimator's answer to ``relocalize``, beside the frames' path: a fresh index, and one frame looked up in it."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Sequence
from typing import Any, Generic, Protocol, TypeVar

import structlog

from common import topics
from common.errors import BusError, Refused, RetraverseError
from common.geometry import Uncertain
from common.ids import VertexId
from common.messages import (
    AppearanceQuery,
    Appearances,
    GraphQuery,
    MapRecord,
    Message,
    Relocalization,
    Relocalize,
    Submap,
    VertexRecord,
)
from common.posegraph import PoseGraph, from_topology
from common.topics import Topic
from services.estimator.pipeline import Localized, Step
from services.estimator.relocalization.appearance import Appearance
from services.estimator.relocalization.index import AppearanceIndex
from services.estimator.relocalization.relocalizer import Found, NotFound, Relocalizer
from services.estimator.relocalization.settings import RelocalizationSettings

log = structlog.get_logger()

Live = TypeVar("Live")
Local = TypeVar("Local")
Live_contra = TypeVar("Live_contra", contravariant=True)

Ask = Callable[[Topic, Message, float], Any]
"""Asks a question of the bus with a deadline in seconds, as :meth:`common.bus.Bus.ask` does."""


class PlaceUnknown(RetraverseError):
    """The robot did not find itself; the text says why."""


class Searcher(Protocol[Live_contra, Local]):
    """What is needed of a sensor's pipeline: :class:`services.estimator.pipeline.Pipeline` has it."""

    def read(self, record: VertexRecord) -> Local:
        """The submap of a stored vertex; ValueError where it is none of this pipeline's."""
        ...

    def search(self, submap: Local, live: Live_contra) -> Localized:
        """Localizes a vehicle that is assumed within a metre or so of the vertex."""
        ...


class Finder(Generic[Live, Local]):
    """Finds the robot on a network of which the map store tells.

    The index is that of one environment: the robot's own at first, then whichever was asked for last. It is kept fresh
    by :meth:`run` while the robot is idle, so that driving is not disturbed, and before each answer.

    Attributes:
        searcher: a pipeline that no other thread uses; None until the camera is known.
    """

    def __init__(
        self,
        ask: Ask,
        appearance_of: Callable[[Live], Appearance],
        environment: str,
        max_age_s: float,
        settings: RelocalizationSettings | None = None,
    ) -> None:
        """``appearance_of`` says what a frame looks like, as its vertex would keep it; older frames are not used."""
        self.searcher: Searcher[Live, Local] | None = None
        self._ask = ask
        self._appearance_of = appearance_of
        self._max_age_s = max_age_s
        self._settings = settings or RelocalizationSettings()
        self._network = _Network(environment, self._settings)
        self._lock = threading.Lock()
        self._seen: tuple[Step[Live], float] | None = None
        self._idle = True

    def see(self, step: Step[Live], *, idle: bool) -> None:
        """Takes the newest frame, and whether the robot is idle; costs the frame's path nothing."""
        self._seen, self._idle = (step, time.monotonic()), idle

    def answer(self, question: Relocalize) -> Relocalization:
        """Where the newest frame was taken.

        Raises:
            PlaceUnknown: there is no frame, or it fits no place, or more than one.
            BusError: the map store does not answer.
        """
        with self._lock:
            if question.environment != self._network.environment:
                self._network = _Network(question.environment, self._settings)
            self._refresh(self._network)
            if len(self._network.index) == 0:
                raise PlaceUnknown(f"environment '{question.environment}' has no vertex that could be recognised")
            step, searcher = self._newest(), self.searcher
            if step is None or searcher is None:
                raise PlaceUnknown("there is no frame of the sensor to find the robot by")
            found = self._relocalizer(searcher).find(step.live, self._appearance_of(step.live))
        if isinstance(found, NotFound):
            raise PlaceUnknown(found.reason)
        return _answer(found, step.stamp)

    def run(self, stop: threading.Event) -> None:
        """Takes new vertices in, now and then, until the service stops."""
        told = ""
        while not stop.is_set():
            if self._idle:
                try:
                    with self._lock:
                        self._refresh(self._network)
                    told = ""
                except BusError as error:
                    if str(error) != told:
                        log.warning("the places to recognise cannot be read", reason=str(error))
                    told = str(error)
            stop.wait(self._settings.period_s)

    def _newest(self) -> Step[Live] | None:
        """The newest frame, unless the sensor has been silent since."""
        if self._seen is None or time.monotonic() - self._seen[1] > self._max_age_s:
            return None
        return self._seen[0]

    def _refresh(self, network: _Network) -> None:
        """Takes in what the store has and the index has not."""
        more = True
        while more:
            question = AppearanceQuery(environment=network.environment, known=network.known)
            page: Appearances = self._ask(topics.APPEARANCE, question, self._settings.store_s)
            network.take(page)
            more = page.more
        network.index.prepare()

    def _relocalizer(self, searcher: Searcher[Live, Local]) -> Relocalizer[Live, Local]:
        return Relocalizer(
            self._network.index,
            self._graph(),
            searcher.search,
            lambda vertices: self._submaps(searcher, vertices),
            self._settings,
        )

    def _graph(self) -> PoseGraph:
        question = GraphQuery(environment=self._network.environment)
        return from_topology(self._ask(topics.TOPOLOGY, question, self._settings.store_s))

    def _submaps(self, searcher: Searcher[Live, Local], vertices: Sequence[VertexId]) -> dict[VertexId, Local]:
        """Those submaps that can be had and read."""
        try:
            answer: Submap = self._ask(topics.SUBMAP, GraphQuery(vertices=list(vertices)), self._settings.store_s)
        except Refused as error:
            # A map was removed meanwhile, say: the robot is found by the next question.
            raise PlaceUnknown(f"the map store refuses the places that look most alike: {error}") from None
        found: dict[VertexId, Local] = {}
        for record in answer.vertices:
            try:
                found[record.id] = searcher.read(record)
            except ValueError as error:
                log.warning("a stored keyframe cannot be used", vertex=str(record.id), reason=str(error))
        return found


class _Network:
    """An environment's index, and how much of each map it has taken in."""

    def __init__(self, environment: str, settings: RelocalizationSettings) -> None:
        self.environment = environment
        self.index = AppearanceIndex(settings)
        self.known: dict[str, int] = {}
        self._limit = settings.max_vertices
        self._left_out: set[str] = set()

    def take(self, page: Appearances) -> None:
        """Takes a page of vertices in, forgets the maps that are gone, and keeps within the bound."""
        present = {record.id for record in page.maps}
        for map_id in self.known.keys() - present:
            self.index.remove_map(map_id)
            del self.known[map_id]
        ends = {stream: counts.cumsum() for stream, counts in page.counts.items()}
        for j, (k, index) in enumerate(page.vertices.tolist()):
            vertex = VertexId(page.maps[k].id, index)
            self.known[vertex.map_id] = index + 1
            if vertex.map_id not in self._left_out:
                found = {s: page.descriptors[s][end[j] - page.counts[s][j] : end[j]] for s, end in ends.items()}
                self.index.add(vertex, found)
        self._keep_within_bound(page.maps)

    def _keep_within_bound(self, maps: Sequence[MapRecord]) -> None:
        """Leaves the oldest recorded maps out; without the taught ones the robot could not drive on."""
        for record in maps:
            if len(self.index) <= self._limit:
                return
            if record.generation > 0 and record.id not in self._left_out:
                self._left_out.add(record.id)
                self.index.remove_map(record.id)


def _answer(found: Found, stamp: int) -> Relocalization:
    pose: Uncertain = found.T_vertex_live
    return Relocalization(
        stamp=stamp,
        vertex=found.vertex,
        T_vertex_robot=pose.T,
        covariance=pose.covariance,
        inliers=found.inliers,
        stream=found.stream,
    )
