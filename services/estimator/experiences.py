"""Recorded experiences beside a route: where their vertices lie, and which few are worth joining to the map.

The spatio-temporal pose graph of VT&R3: a repeat's vertices are joined to the privileged ones by spatial edges wherever
it localized, and to each other by temporal edges, which carry on where it did not. So every vertex near the route can
be placed in a privileged one's frame, and what it saw serves as a bridge between the privileged light and today's.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from pydantic import Field

from common import geometry
from common.geometry import Array, Uncertain
from common.ids import VertexId
from common.posegraph import PoseGraph

_DAY_H = 24.0
_HOUR_NS = 3.6e12


@dataclass(frozen=True, slots=True)
class ExperienceSettings:
    """Multi-experience localization.

    Attributes:
        window: privileged vertices before the trunk, and after it, that are joined with it.
        path_drift, path_turn: standard deviation of the path between them, metres and radians a metre.
        most: experiences that are joined to the privileged path's map at a time, which bounds the work of a frame.
        reach: farthest that a joined vertex lies from the trunk, metres.
        bridge: how far a vertex is placed by temporal edges from the next one that was localized, metres.
        memory: frames over which success is remembered.
        patience: frames whose success counts as much as age and time of day.
        age: days after which an experience's age counts for 1/e.
    """

    window: Annotated[int, Field(ge=0, le=5)] = 2
    path_drift: Annotated[float, Field(ge=0)] = 0.01
    path_turn: Annotated[float, Field(ge=0)] = 0.002
    most: Annotated[int, Field(ge=0, le=20)] = 3
    reach: Annotated[float, Field(gt=0)] = 0.6
    bridge: Annotated[float, Field(ge=0)] = 8.0
    memory: Annotated[float, Field(gt=0)] = 50.0
    patience: Annotated[float, Field(gt=0)] = 10.0
    age: Annotated[float, Field(gt=0)] = 30.0


class RouteExperiences:
    """The vertices of every other map that lie beside a route, by map and by place in the route."""

    def __init__(
        self, graph: PoseGraph, vertices: Sequence[VertexId], path: Array, settings: ExperienceSettings
    ) -> None:
        """Lays a graph's experiences along a route of N vertices with poses ``path`` (N, 4, 4) in the first's frame.

        Raises:
            GraphError: the graph contradicts itself.
        """
        self._path = np.asarray(path, dtype=np.float64)
        self._settings = settings
        place = {vertex: index for index, vertex in enumerate(vertices)}
        own = {vertex.map_id for vertex in vertices}
        others = [map_id for map_id in graph.experiences if map_id not in own]
        self.stamps: dict[str, int] = {k: graph.experiences[k].record.stamp for k in others}
        self._arclength = geometry.arclength(self._path)
        self._beside: dict[int, dict[str, _Placed]] = {}
        for map_id in others:
            for vertex, index, T in self._placed(graph, map_id, place):
                self._lay(vertex, index, T)

    def near(self, index: int, ranking: Iterable[str]) -> list[tuple[VertexId, Uncertain]]:
        """The nearest vertices of the best experiences at a place of the route, with ``T_trunk_vertex``.

        ``ranking`` are maps, the best first; of those that have a vertex there, the first few are taken.
        """
        here = self._beside.get(index, {})
        chosen = itertools.islice((here[map_id] for map_id in ranking if map_id in here), self._settings.most)
        return [(found.vertex, self._between(index, found.index) @ found.T_trunk_vertex) for found in chosen]

    def _between(self, index: int, other: int) -> Uncertain:
        """``T_index_other`` of two places of the route that are close together."""
        return Uncertain.exactly(geometry.inverse(self._path[index]) @ self._path[other])

    def _placed(
        self, graph: PoseGraph, map_id: str, place: Mapping[VertexId, int]
    ) -> Iterator[tuple[VertexId, int, Uncertain]]:
        """Vertices of a map with a place in the route and their pose there."""
        vertices = graph.vertices(map_id)
        known = [self._localized(graph, vertex, place) for vertex in vertices]
        ahead = _carried(graph, vertices, known, self._settings.bridge)
        behind = _carried(graph, vertices[::-1], known[::-1], self._settings.bridge)[::-1]
        for vertex, first, second in zip(vertices, ahead, behind, strict=True):
            choices = [found for found in (first, second) if found is not None]
            if choices:
                _, index, T = min(choices, key=lambda found: found[0])
                yield vertex, index, T

    @staticmethod
    def _localized(graph: PoseGraph, vertex: VertexId, place: Mapping[VertexId, int]) -> tuple[int, Uncertain] | None:
        """The place that a spatial edge gives a vertex, the edge of least covariance if there are several."""
        edges = [
            (place[other], graph.edge(vertex, other))
            for other in graph.neighbours(vertex, spatial=True)
            if other in place
        ]
        if not edges:
            return None
        index, edge = min(edges, key=lambda found: float(np.trace(found[1].T_a_b.covariance)))
        return index, edge.transform(edge.b if edge.a == vertex else edge.a)

    def _lay(self, vertex: VertexId, index: int, T_trunk_vertex: Uncertain) -> None:
        """Enters a vertex at every place of the route within reach of it."""
        reach = self._settings.reach
        # A route that crosses itself comes near the vertex elsewhere, too.
        far = 2.0 * reach + float(np.linalg.norm(T_trunk_vertex.T[:3, 3]))
        here = self._arclength[index]
        first, last = np.searchsorted(self._arclength, [here - far, here + far])
        T_trunk_path = geometry.inverse(self._path[index]) @ self._path[first:last]
        distance = np.linalg.norm(T_trunk_path[:, :3, 3] - T_trunk_vertex.T[:3, 3], axis=1)
        for near in np.flatnonzero(distance <= reach):
            others = self._beside.setdefault(int(first + near), {})
            if vertex.map_id not in others or distance[near] < others[vertex.map_id].distance:
                others[vertex.map_id] = _Placed(float(distance[near]), vertex, index, T_trunk_vertex)


@dataclass(frozen=True, slots=True)
class _Placed:
    """A vertex ``distance`` metres from a place of the route, with its pose in the frame of place ``index``."""

    distance: float
    vertex: VertexId
    index: int
    T_trunk_vertex: Uncertain


def _carried(
    graph: PoseGraph,
    vertices: Sequence[VertexId],
    known: Sequence[tuple[int, Uncertain] | None],
    bridge: float,
) -> list[tuple[float, int, Uncertain] | None]:
    """Places in the order of ``vertices``: known, or carried on from the last known by temporal edges; with metres."""
    out: list[tuple[float, int, Uncertain] | None] = []
    last: tuple[float, int, Uncertain] | None = None
    for position, (vertex, found) in enumerate(zip(vertices, known, strict=True)):
        if found is not None:
            last = (0.0, *found)
        elif last is not None:
            metres, index, T = last
            before = vertices[position - 1]
            edge = graph.edge(before, vertex)
            last = metres + edge.length, index, T @ edge.transform(before)
            if last[0] > bridge:
                last = None
        out.append(last)
    return out


class ExperienceChoice:
    """Which experiences to join: those that helped lately, then the young ones and those of this time of day."""

    def __init__(self, stamps: Mapping[str, int], settings: ExperienceSettings) -> None:
        """``stamps`` are when each experience was made, nanoseconds."""
        self._stamps = stamps
        self._settings = settings
        self._success: dict[str, float] = {}
        self._seen: dict[str, float] = {}

    def ranking(self, now: int) -> list[str]:
        """All experiences, the best first; ``now`` is the live frame's stamp."""
        return sorted(self._stamps, key=lambda k: (-self.score(k, now), k))

    def score(self, map_id: str, now: int) -> float:
        """Worth of an experience, 0 to 1."""
        seen = self._seen.get(map_id, 0.0)
        most = max(self._success.values(), default=0.0)
        success = self._success.get(map_id, 0.0) / most if most > 0.0 else 0.0
        patience = self._settings.patience
        return (patience * self._expected(self._stamps[map_id], now) + seen * success) / (patience + seen)

    def credit(self, inliers: Mapping[str, int]) -> None:
        """Takes what the joined experiences gave to a localization; what was not joined is slowly forgotten."""
        rate = 1.0 / self._settings.memory
        total = max(sum(inliers.values()), 1)
        for map_id in self._seen:
            if map_id not in inliers:
                self._seen[map_id] *= 1.0 - rate
        for map_id, count in inliers.items():
            if map_id not in self._stamps:
                continue
            share = count / total
            self._success[map_id] = (1.0 - rate) * self._success.get(map_id, share) + rate * share
            self._seen[map_id] = min(self._seen.get(map_id, 0.0) + 1.0, self._settings.memory)

    def _expected(self, stamp: int, now: int) -> float:
        """Worth by age and time of day alone, half each."""
        hours = (now - stamp) / _HOUR_NS
        young = math.exp(-max(hours, 0.0) / (_DAY_H * self._settings.age))
        alike = 0.5 + 0.5 * math.cos(2.0 * math.pi * hours / _DAY_H)
        return 0.5 * (young + alike)
