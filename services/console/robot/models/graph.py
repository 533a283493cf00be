"""The pose graph as a page draws it: sections that change only where the graph does."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from common.ids import VertexId
from common.messages import MapRecord, MapSummary, Restriction, Topology
from services.console.channel import Channel
from services.console.robot.models.layout import Plane, compose, lay_out

CHUNK = 256
"""Vertices in a section: what one new vertex has sent again is no more."""


@dataclass(frozen=True, slots=True)
class Drawn:
    """A topology, laid out; made beside the loop that shows it.

    Attributes:
        topology: as the map store has it.
        poses: of each map's vertices, (N, 3).
        seconds: what asking and laying out took.
    """

    topology: Topology
    poses: list[Plane]
    seconds: float

    @classmethod
    def of(cls, topology: Topology, since: float) -> Drawn:
        """Lays a topology out that was asked for at a monotonic time."""
        poses = lay_out(topology)
        return cls(topology, poses, time.monotonic() - since)


class GraphModel:
    """The graph in a channel's sections.

    ``map/<id>`` describes a map, ``v/<id>/<chunk>`` holds x and y of 256 of its vertices in centimetres; ``places``,
    ``restrictions`` and ``joints`` name vertices as ``[map, index]``. Between two topologies the graph grows by the
    vertices that odometry tells of.
    """

    def __init__(self, channel: Channel) -> None:
        self._channel = channel
        self._poses: dict[str, list[tuple[float, float, float]]] = {}
        self.environment = ""
        self.taught: frozenset[str] = frozenset()
        self.places: dict[str, VertexId] = {}

    def take(self, drawn: Drawn) -> None:
        """Shows a topology in place of what was shown; what odometry told of meanwhile stays until it is stored."""
        topology = drawn.topology
        same = topology.environment == self.environment
        before, self._poses = (self._poses if same else {}), {}
        self.environment = topology.environment
        self.taught = frozenset(s.record.id for s in topology.maps if s.record.generation == 0)
        self.places = dict(topology.places)
        for summary, poses in zip(topology.maps, drawn.poses, strict=True):
            map_id = summary.record.id
            known = before.get(map_id, [])
            self._poses[map_id] = [tuple(pose) for pose in poses.tolist()]
            if not summary.finished:
                self._poses[map_id] += known[len(poses) :]
            self._show_map(map_id, _described(summary))
        self._forget(set(self._poses))
        self._channel.set("places", {name: [*vertex] for name, vertex in sorted(topology.places.items())})
        self._channel.set("restrictions", [_restriction(one) for one in topology.restrictions])
        self._channel.set("joints", _joints(topology))
        self._channel.set("environment", topology.environment)
        self._channel.set("graph", {"vertices": sum(map(len, self._poses.values())), "maps": len(self._poses)})

    def grow(self, record: MapRecord, vertex: VertexId, pose: Plane) -> None:
        """Shows a vertex that was made just now, at a pose (3,), if it is the next one of its map."""
        poses = self._poses.setdefault(vertex.map_id, [])
        if vertex.index != len(poses) or vertex.map_id != record.id:
            return
        poses.append((float(pose[0]), float(pose[1]), float(pose[2])))
        if vertex.index == 0:
            self._channel.set(f"map/{record.id}", _recorded(record))
        self._show_chunk(vertex.map_id, vertex.index // CHUNK)

    def pose(self, vertex: VertexId) -> Plane | None:
        """Where a vertex is drawn, (3,); None where it is not."""
        poses = self._poses.get(vertex.map_id, [])
        return np.array(poses[vertex.index]) if vertex.index < len(poses) else None

    def place(self, vertex: VertexId, T_vertex_robot: Plane) -> Plane | None:
        """Where a robot is drawn that is at a pose of the plane in a vertex's frame."""
        pose = self.pose(vertex)
        return None if pose is None else compose(pose, T_vertex_robot)

    def is_empty(self, but: str = "") -> bool:
        """Whether nothing is drawn but one map."""
        return not any(poses for map_id, poses in tuple(self._poses.items()) if map_id != but)

    def around(self, vertex: VertexId, count: int) -> list[VertexId]:
        """A vertex, and so many before and after it on its map, as far as there are some."""
        size = len(self._poses.get(vertex.map_id, []))
        near = range(max(vertex.index - count, 0), min(vertex.index + count + 1, size))
        return sorted((VertexId(vertex.map_id, index) for index in near), key=lambda one: abs(one.index - vertex.index))

    def near(self, pose: Plane, metres: float, without: str, most: int) -> list[VertexId]:
        """The taught vertices nearest to a pose, of other maps than one, the nearest first."""
        found: list[tuple[float, VertexId]] = []
        for map_id in self.taught - {without}:
            poses = self._poses.get(map_id, [])
            if poses:
                distances = np.hypot(*(np.array(poses)[:, :2] - pose[:2]).T)
                indices = np.flatnonzero(distances <= metres).tolist()
                found += [(float(distances[index]), VertexId(map_id, index)) for index in indices]
        return [vertex for _, vertex in sorted(found)[:most]]

    def _show_map(self, map_id: str, about: dict[str, Any]) -> None:
        self._channel.set(f"map/{map_id}", about)
        for chunk in range((len(self._poses[map_id]) + CHUNK - 1) // CHUNK):
            self._show_chunk(map_id, chunk)

    def _show_chunk(self, map_id: str, chunk: int) -> None:
        poses = self._poses[map_id][chunk * CHUNK : (chunk + 1) * CHUNK]
        values = [round(100.0 * value) for x, y, _ in poses for value in (x, y)]
        self._channel.set(f"v/{map_id}/{chunk}", values)

    def _forget(self, kept: set[str]) -> None:
        """Shows no more what has been removed."""
        for key in self._channel.keys("map/"):
            if key.removeprefix("map/") not in kept:
                self._channel.drop(key)
        for key in self._channel.keys("v/"):
            _, map_id, chunk = key.split("/")
            if map_id not in kept or int(chunk) * CHUNK >= len(self._poses[map_id]):
                self._channel.drop(key)


def _described(summary: MapSummary) -> dict[str, Any]:
    return _recorded(summary.record) | {
        "length": round(summary.length, 1),
        "finished": summary.finished,
        "start": summary.start_place,
        "end": summary.end_place,
        "sync": summary.sync.value,
    }


def _recorded(record: MapRecord) -> dict[str, Any]:
    return {
        "stamp": record.stamp // 1_000_000,
        "generation": record.generation,
        "robot": record.robot,
        "sensor": record.sensor,
    }


def _restriction(one: Restriction) -> dict[str, Any]:
    return {"map": one.map, "first": one.first, "last": one.last, "speed": one.speed, "reason": one.reason}


def _joints(topology: Topology) -> list[list[Any]]:
    """The edges between two taught maps: a repeat's own many are no news."""
    ids: Sequence[str] = [summary.record.id for summary in topology.maps]
    taught = np.array([summary.record.generation == 0 for summary in topology.maps], dtype=bool)
    edges = topology.edges[np.flatnonzero(topology.spatial)]
    if not len(edges):
        return []
    between = taught[edges[:, 0]] & taught[edges[:, 2]]
    return [[ids[k_a], i_a, ids[k_b], i_b] for k_a, i_a, k_b, i_b in edges[between].tolist()]
