"""An index of many vertices by what they look like: a frame's descriptors in, the vertices that have the like out."""

from __future__ import annotations

import threading
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from common.ids import VertexId
from services.estimator.relocalization import tables
from services.estimator.relocalization.appearance import Appearance
from services.estimator.relocalization.settings import RelocalizationSettings
from services.estimator.relocalization.tables import Tables

_GROUP = 8
"""Vertices of a map that see much the same things: a descriptor that several of them have is no less rare."""

Scores = NDArray[np.float64]


class AppearanceIndex:
    """Vertices with their descriptors, by stream; descriptors of two streams are never compared.

    Any thread may call any method: asking takes the tables as they are, and works beside whatever changes them.
    """

    def __init__(self, settings: RelocalizationSettings | None = None) -> None:
        self._settings = settings or RelocalizationSettings()
        self._vertices: dict[VertexId, dict[str, NDArray[np.uint8]]] = {}
        self._built: tuple[list[VertexId], dict[str, Tables]] | None = None
        self._lock = threading.Lock()

    def __len__(self) -> int:
        return len(self._vertices)

    def __contains__(self, vertex: VertexId) -> bool:
        return vertex in self._vertices

    def add(self, vertex: VertexId, appearance: Appearance) -> None:
        """Takes a vertex in, or what is newly known of it; beyond a bound, descriptors are left out evenly."""
        kept = {stream: _thinned(found, self._settings.descriptors) for stream, found in appearance.items()}
        with self._lock:
            self._vertices[vertex] = kept
            self._built = None

    def remove_map(self, map_id: str) -> None:
        """Forgets the vertices of a map."""
        with self._lock:
            self._vertices = {v: kept for v, kept in self._vertices.items() if v.map_id != map_id}
            self._built = None

    def prepare(self) -> None:
        """Builds the tables anew where something has changed, so that the next question need not."""
        self._tables()

    def rank(self, appearance: Appearance) -> list[tuple[VertexId, float]]:
        """The vertices that look like it at all, the likest first, each with its score."""
        vertices, built = self._tables()
        scores = np.zeros(len(vertices))
        for stream, found in appearance.items():
            if stream in built and len(found):
                scores += self._votes(built[stream], found)
        order = np.argsort(-scores, kind="stable")
        return [(vertices[i], float(scores[i])) for i in order[: np.count_nonzero(scores)]]

    def _votes(self, table: Tables, found: NDArray[np.uint8]) -> Scores:
        s = self._settings
        queries = _thinned(found, s.query_descriptors)
        return tables.votes(table, queries, s.max_distance, s.max_bucket)

    def _tables(self) -> tuple[list[VertexId], dict[str, Tables]]:
        with self._lock:
            if self._built is None:
                self._built = list(self._vertices), _build(self._vertices)
            return self._built


def warm_up() -> None:
    """Compiles everything that an index needs, or reads it from disk."""
    index = AppearanceIndex()
    descriptors = {"any": np.zeros((1, 32), dtype=np.uint8)}
    index.add(VertexId("any", 0), descriptors)
    index.rank(descriptors)


def _build(vertices: Mapping[VertexId, Mapping[str, NDArray[np.uint8]]]) -> dict[str, Tables]:
    numbers: dict[tuple[str, int], int] = {}
    groups = np.array([numbers.setdefault((v.map_id, v.index // _GROUP), len(numbers)) for v in vertices], np.int32)
    built = {}
    for stream in sorted({stream for kept in vertices.values() for stream in kept}):
        found = [kept.get(stream, _NONE) for kept in vertices.values()]
        owners = np.repeat(np.arange(len(found), dtype=np.int32), [len(f) for f in found])
        built[stream] = tables.build(np.concatenate(found), owners, groups)
    return built


_NONE = np.zeros((0, 32), dtype=np.uint8)


def _thinned(descriptors: NDArray[np.uint8], limit: int) -> NDArray[np.uint8]:
    """At most ``limit`` of the descriptors, evenly chosen, in memory of their own."""
    if len(descriptors) <= limit:
        return np.array(descriptors, dtype=np.uint8)
    return descriptors[np.linspace(0, len(descriptors) - 1, limit).astype(np.int64)]
