"""Submaps near the robot, fetched from the map store ahead of need and kept."""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Callable, Sequence
from typing import Generic, TypeVar

import structlog

from common.errors import BusError, Refused
from common.ids import VertexId
from common.messages import VertexRecord

log = structlog.get_logger()

_BATCH = 8
_RETRY_S = 0.2

V = TypeVar("V")


class SubmapCache(Generic[V]):
    """Decoded submaps by vertex; a thread fetches those that are wanted, in the order of the wish.

    The frame's path only looks up: a submap that is not there yet costs a localization, never a wait.
    """

    def __init__(
        self,
        fetch: Callable[[list[VertexId]], Sequence[VertexRecord]],
        read: Callable[[VertexRecord], V],
        capacity: int = 200,
    ) -> None:
        self._fetch = fetch
        self._read = read
        self._capacity = capacity
        self._kept: OrderedDict[VertexId, V] = OrderedDict()
        self._wanted: list[VertexId] = []
        self._bad: set[VertexId] = set()
        self._lock = threading.Lock()
        self._wake = threading.Event()

    def get(self, vertex: VertexId) -> V | None:
        """The submap of a vertex, if it is here."""
        with self._lock:
            submap = self._kept.get(vertex)
            if submap is not None:
                self._kept.move_to_end(vertex)
            return submap

    def put(self, vertex: VertexId, submap: V) -> None:
        """Keeps a submap that was made here."""
        with self._lock:
            self._keep(vertex, submap)

    def want(self, vertices: Sequence[VertexId]) -> None:
        """Says which submaps will be needed, most urgent first; replaces the last wish."""
        with self._lock:
            self._wanted = [v for v in vertices if v not in self._kept and v not in self._bad]
        if self._wanted:
            self._wake.set()

    @property
    def missing(self) -> bool:
        """Whether a submap that is wanted is still to be fetched."""
        return bool(self._next_batch())

    def run(self, stop: threading.Event) -> None:
        """Fetches until the service stops."""
        while not stop.is_set():
            self._wake.wait(_RETRY_S)
            self._wake.clear()
            while (batch := self._next_batch()) and not stop.is_set():
                try:
                    self._take(batch, self._fetch(batch))
                except Refused:
                    self._take_singly(batch)
                except BusError as error:
                    log.warning("submaps cannot be fetched", reason=str(error))
                    stop.wait(_RETRY_S)

    def _next_batch(self) -> list[VertexId]:
        with self._lock:
            return [v for v in self._wanted if v not in self._kept and v not in self._bad][:_BATCH]

    def _take_singly(self, batch: list[VertexId]) -> None:
        """One vertex that the store does not know must not keep the others away."""
        for vertex in batch:
            try:
                self._take([vertex], self._fetch([vertex]))
            except Refused as error:
                log.warning("a submap is refused", vertex=str(vertex), reason=str(error))
                self._take([vertex], [])

    def _take(self, batch: list[VertexId], records: Sequence[VertexRecord]) -> None:
        found: dict[VertexId, V] = {}
        for record in records:
            try:
                found[record.id] = self._read(record)
            except ValueError as error:
                log.warning("a stored keyframe cannot be used", vertex=str(record.id), reason=str(error))
        with self._lock:
            for vertex in batch:
                if vertex in found:
                    self._keep(vertex, found[vertex])
                else:
                    self._bad.add(vertex)

    def _keep(self, vertex: VertexId, submap: V) -> None:
        self._kept[vertex] = submap
        while len(self._kept) > self._capacity:
            self._kept.popitem(last=False)
