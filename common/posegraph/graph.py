"""Vertices, edges and experiences of one environment, and the transforms along any path between them.

The graph is relative (VT&R3 overview, *Spatio-Temporal Pose Graph*): each vertex is a frame of its own and only edges
say where frames are. There is no common frame, and two paths between two vertices may give two transforms.
"""

from __future__ import annotations

import heapq
import itertools
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from common import geometry
from common.errors import GraphError
from common.geometry import Array, Uncertain
from common.ids import VertexId
from common.messages import MapRecord, Restriction

Allow = Callable[[VertexId], bool]
"""Says of a vertex whether a search may go through it."""


@dataclass(frozen=True, slots=True, eq=False)
class Edge:
    """``T_a_b`` between two vertices: temporal by odometry, spatial by localization. ``length`` is in metres."""

    a: VertexId
    b: VertexId
    T_a_b: Uncertain
    spatial: bool
    length: float = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "length", math.hypot(*self.T_a_b.T[:3, 3].tolist()))

    def transform(self, origin: VertexId) -> Uncertain:
        """The transform seen from one of its ends: ``T_a_b`` from a, ``T_b_a`` from b."""
        return self.T_a_b if origin == self.a else self.T_a_b.inverse()


@dataclass(slots=True)
class Experience:
    """One drive: its record, how many vertices it has, and what the map store says of it.

    ``bytes`` is the size of its keyframes in the store, 0 where nobody asked the store; ``length`` is in metres;
    ``start_place`` and ``end_place`` are what it leads from and to, where that was told.
    """

    record: MapRecord
    vertices: int = 0
    finished: bool = False
    bytes: int = 0
    length: float = field(default=0.0, compare=False)
    start_place: str | None = None
    end_place: str | None = None

    @property
    def privileged(self) -> bool:
        """Whether it was taught, so that a repeat may follow it."""
        return self.record.generation == 0


class PoseGraph:
    """The spatio-temporal pose graph of an environment. It may be read and written by one thread at a time.

    Two vertices are joined by at most one edge. What contradicts the graph is refused when it is added, so that
    there are no dangling edges and no gaps in an experience's indices.
    """

    def __init__(self, environment: str) -> None:
        self.environment = environment
        self.experiences: dict[str, Experience] = {}
        self.places: dict[str, VertexId] = {}
        self.restrictions: list[Restriction] = []
        self.edges: list[Edge] = []
        self._adjacent: dict[VertexId, dict[VertexId, Edge]] = {}

    def __len__(self) -> int:
        return len(self._adjacent)

    def __contains__(self, vertex: VertexId) -> bool:
        return vertex in self._adjacent

    # --- building ----------------------------------------------------------------------------------------------------

    def add_experience(self, record: MapRecord) -> Experience:
        """A new experience without vertices, or the one that there is under this record.

        Raises:
            GraphError: it belongs to another environment, or its id has another record.
        """
        if record.environment != self.environment:
            raise GraphError(f"map {record.id} belongs to environment '{record.environment}', not '{self.environment}'")
        known = self.experiences.setdefault(record.id, Experience(record))
        if known.record != record:
            raise GraphError(f"map {record.id} is known with another record")
        return known

    def add_vertex(self, vertex: VertexId) -> None:
        """The next vertex of an experience.

        Raises:
            GraphError: the experience is unknown, or the index is not its next one.
        """
        experience = self.experience(vertex.map_id)
        if vertex.index != experience.vertices:
            raise GraphError(f"{vertex} cannot be added: the next vertex of its map is {experience.vertices}")
        experience.vertices += 1
        self._adjacent[vertex] = {}

    def add_edge(self, edge: Edge) -> None:
        """An edge between two vertices of the graph.

        Raises:
            GraphError: an end is unknown, both ends are one, or the two are joined already.
        """
        neighbours, others = self._edges_of(edge.a), self._edges_of(edge.b)
        if edge.a == edge.b:
            raise GraphError(f"an edge cannot join {edge.a} to itself")
        if edge.b in neighbours:
            raise GraphError(f"{edge.a} and {edge.b} are joined by an edge already")
        neighbours[edge.b] = others[edge.a] = edge
        self.edges.append(edge)

    def name_place(self, name: str, vertex: VertexId) -> None:
        """Names a vertex; naming another one moves the name.

        Raises:
            GraphError: the vertex is unknown.
        """
        self._edges_of(vertex)
        self.places[name] = vertex

    # --- asking ------------------------------------------------------------------------------------------------------

    def experience(self, map_id: str) -> Experience:
        """The experience of a map.

        Raises:
            GraphError: it is unknown.
        """
        try:
            return self.experiences[map_id]
        except KeyError:
            raise GraphError(f"environment '{self.environment}' has no map {map_id}") from None

    def vertices(self, map_id: str) -> list[VertexId]:
        """The vertices of a map in driving order.

        Raises:
            GraphError: the map is unknown.
        """
        return [VertexId(map_id, index) for index in range(self.experience(map_id).vertices)]

    def privileged(self, vertex: VertexId) -> bool:
        """Whether a vertex was taught, so that a repeat may follow it.

        Raises:
            GraphError: its map is unknown.
        """
        return self.experience(vertex.map_id).privileged

    def neighbours(self, vertex: VertexId, *, spatial: bool | None = None) -> list[VertexId]:
        """The vertices that an edge joins to this one: by spatial edges, by temporal edges, or (None) by either.

        Raises:
            GraphError: the vertex is unknown.
        """
        return [v for v, edge in self._edges_of(vertex).items() if spatial is None or edge.spatial is spatial]

    def edge(self, a: VertexId, b: VertexId) -> Edge:
        """The edge that joins two vertices, whichever its direction.

        Raises:
            GraphError: a vertex is unknown, or no edge joins the two.
        """
        try:
            return self._edges_of(a)[b]
        except KeyError:
            self._edges_of(b)
            raise GraphError(f"no edge joins {a} and {b}") from None

    def transform(self, a: VertexId, b: VertexId) -> Uncertain:
        """``T_a_b`` with covariance along the shortest path.

        Raises:
            GraphError: a vertex is unknown, or nothing connects the two.
        """
        return self.transform_along(self.shortest_path(a, b))

    def transform_along(self, path: Sequence[VertexId]) -> Uncertain:
        """``T_first_last`` with covariance along a path, its edges taken as independent.

        To first order, as in Barfoot and Furgale, *Associating uncertainty with three-dimensional poses*, eq. 36.

        Raises:
            GraphError: the path is empty, or no edge joins two that follow each other in it.
        """
        transforms, covariances = self._steps(path)
        poses = _accumulate(transforms)
        Ad = geometry.adjoint(poses[:-1])
        return Uncertain(poses[-1], (Ad @ covariances @ np.swapaxes(Ad, -1, -2)).sum(0))

    def poses_along(self, path: Sequence[VertexId]) -> Array:
        """``T_first_vertex`` (N, 4, 4) for the N vertices of a path.

        Raises:
            GraphError: the path is empty, or no edge joins two that follow each other in it.
        """
        return _accumulate(self._steps(path)[0])

    def length_along(self, path: Sequence[VertexId]) -> float:
        """Metres along a path's edges.

        Raises:
            GraphError: no edge joins two that follow each other in it.
        """
        return sum(self.edge(a, b).length for a, b in itertools.pairwise(path))

    def shortest_path(self, a: VertexId, b: VertexId, allow: Allow | None = None) -> list[VertexId]:
        """The path from a to b of fewest metres, along edges in either direction, through allowed vertices.

        Raises:
            GraphError: a vertex is unknown, or nothing connects the two.
        """
        self._edges_of(b)
        previous: dict[VertexId, VertexId] = {}
        for _, vertex, before in self._nearest_first(a, allow):
            previous[vertex] = before
            if vertex == b:
                return _trace(previous, b)
        raise GraphError(f"no path of edges connects {a} and {b}")

    def reachable(self, start: VertexId, allow: Allow | None = None) -> set[VertexId]:
        """Every vertex that edges in either direction connect to ``start`` through allowed vertices, itself included.

        Raises:
            GraphError: the start is unknown.
        """
        return {vertex for _, vertex, _ in self._nearest_first(start, allow)}

    def within(self, start: VertexId, metres: float, allow: Allow | None = None) -> dict[VertexId, float]:
        """Metres along the edges to each allowed vertex that is no farther than ``metres``, the nearest first.

        Raises:
            GraphError: the start is unknown.
        """
        near = itertools.takewhile(lambda found: found[0] <= metres, self._nearest_first(start, allow))
        return {vertex: distance for distance, vertex, _ in near}

    def window(
        self, trunk: VertexId, vertices: int, metres: float = math.inf, allow: Allow | None = None
    ) -> dict[VertexId, Uncertain]:
        """``T_trunk_vertex`` of the allowed vertices nearest to a trunk along the edges, the trunk first.

        At most ``vertices`` of them, none farther than ``metres``. It goes through temporal and spatial edges, and so
        gathers what one joint map of several experiences is made of.

        Raises:
            GraphError: the trunk is unknown.
        """
        found: dict[VertexId, Uncertain] = {}
        for distance, vertex, before in self._nearest_first(trunk, allow):
            if distance > metres or len(found) >= vertices:
                break
            if vertex == before:
                found[vertex] = Uncertain.identity()
            else:
                found[vertex] = found[before] @ self._adjacent[before][vertex].transform(before)
        return found

    # --- inside ------------------------------------------------------------------------------------------------------

    def _edges_of(self, vertex: VertexId) -> dict[VertexId, Edge]:
        try:
            return self._adjacent[vertex]
        except KeyError:
            experience = self.experience(vertex.map_id)
            raise GraphError(f"there is no vertex {vertex}: its map has {experience.vertices} vertices") from None

    def _nearest_first(self, start: VertexId, allow: Allow | None) -> Iterator[tuple[float, VertexId, VertexId]]:
        """Dijkstra's search: each vertex once with its distance (m) and the one before it; ``start``'s is itself."""
        self._edges_of(start)
        heap = [(0.0, start, start)]
        best = {start: 0.0}
        done: set[VertexId] = set()
        while heap:
            distance, vertex, before = heapq.heappop(heap)
            if vertex in done:
                continue
            done.add(vertex)
            yield distance, vertex, before
            for neighbour, edge in self._adjacent[vertex].items():
                through = distance + edge.length
                if through < best.get(neighbour, math.inf) and (allow is None or allow(neighbour)):
                    best[neighbour] = through
                    heapq.heappush(heap, (through, neighbour, vertex))

    def _steps(self, path: Sequence[VertexId]) -> tuple[Array, Array]:
        """Transforms (N-1, 4, 4) from each vertex of a path to the next, and their covariances (N-1, 6, 6)."""
        if not path:
            raise GraphError("a path without vertices has no transform")
        self._edges_of(path[0])
        edges = [self.edge(a, b) for a, b in itertools.pairwise(path)]
        if not edges:
            return np.empty((0, 4, 4)), np.empty((0, 6, 6))
        transforms = np.stack([edge.T_a_b.T for edge in edges])
        covariances = np.stack([edge.T_a_b.covariance for edge in edges])
        against = np.array([edge.a != origin for edge, origin in zip(edges, path[:-1], strict=True)])
        transforms[against] = geometry.inverse(transforms[against])
        Ad = geometry.adjoint(transforms[against])
        covariances[against] = Ad @ covariances[against] @ np.swapaxes(Ad, -1, -2)
        return transforms, covariances


def _accumulate(transforms: Array) -> Array:
    """Poses (N + 1, 4, 4), the first the identity, of N transforms from each to the next."""
    poses = np.empty((len(transforms) + 1, 4, 4))
    poses[0] = np.eye(4)
    for index, transform in enumerate(transforms):
        np.matmul(poses[index], transform, out=poses[index + 1])
    return poses


def _trace(previous: dict[VertexId, VertexId], end: VertexId) -> list[VertexId]:
    """The path to ``end`` by each vertex's previous one."""
    path = [end]
    while previous[path[-1]] != path[-1]:
        path.append(previous[path[-1]])
    return path[::-1]
