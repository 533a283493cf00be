"""Taught maps of places that a test makes up: a pose graph, descriptors, and a search that knows the truth."""

from __future__ import annotations

import numpy as np

from common import geometry
from common.geometry import Uncertain
from common.ids import VertexId, new_map_id
from common.messages import MapRecord
from common.posegraph import Edge, PoseGraph
from services.estimator.pipeline import Localized
from services.estimator.relocalization import AppearanceIndex, Relocalizer

STEP = 0.5
SMALL = np.diag(np.repeat([0.01, 0.005], 3) ** 2)


def map_id(number):
    return new_map_id("r1", (number + 1) * 10**9)[:-6] + f"{number:06x}"


def record(number, generation=0):
    return MapRecord(
        id=map_id(number), environment="yard", stamp=number, robot="r1", sensor="front", generation=generation,
        parent=map_id(0) if generation else None,
    )  # fmt: skip


def vertex(number, index):
    return VertexId(map_id(number), index)


class Network:
    """Straight maps of vertices half a metre apart; a live frame is the true pose and the looks of its place.

    ``inliers`` says how many landmarks agree at a vertex, ``offsets`` by what transform its search is wrong.
    """

    def __init__(self, seed=0):
        self.rng = np.random.default_rng(seed)
        self.graph = PoseGraph("yard")
        self.index = AppearanceIndex()
        self.poses: dict[VertexId, np.ndarray] = {}
        self.looks: dict[VertexId, np.ndarray] = {}
        self.inliers: dict[VertexId, int] = {}
        self.offsets: dict[VertexId, np.ndarray] = {}
        self.searched: list[VertexId] = []

    def add_map(self, number, count, origin=(0.0, 0.0), generation=0, like=None):
        """A map along x from an origin; ``like`` names the map whose places its own look like."""
        self.graph.add_experience(record(number, generation))
        T_before_next = Uncertain(geometry.from_xy_yaw(STEP, 0, 0), SMALL)
        for index in range(count):
            name = vertex(number, index)
            self.graph.add_vertex(name)
            self.poses[name] = geometry.from_xy_yaw(origin[0] + STEP * index, origin[1], 0)
            if index:
                self.graph.add_edge(Edge(vertex(number, index - 1), name, T_before_next, spatial=False))
            looks = self.rng.integers(0, 256, (30, 32), dtype=np.uint8)
            self.looks[name] = looks if like is None else self.looks[vertex(like, index)]
            self.index.add(name, {"plain": self.looks[name]})
            self.inliers[name] = 100

    def join(self, a, b):
        T_a_b = geometry.inverse(self.poses[a]) @ self.poses[b]
        self.graph.add_edge(Edge(a, b, Uncertain(T_a_b, SMALL), spatial=True))

    def search(self, submap, live):
        """Succeeds against vertices near the true pose, and where the test says that it does."""
        T_world_live, places = live
        self.searched.append(submap)
        T = geometry.inverse(self.poses[submap]) @ T_world_live
        found = submap in places or np.linalg.norm(T[:2, 3]) < 1.2
        # At a place that only looks like it, the robot seems to stand as it does at the true one.
        if submap in places:
            T = places[submap]
        T = T @ self.offsets.get(submap, np.eye(4))
        inliers = self.inliers[submap]
        success = bool(found and inliers >= 25)
        return Localized(success=success, T_vertex_live=Uncertain(T, SMALL), inliers=inliers, stream="plain", reason="")

    def find(self, at, x=0.1, places=None, missing=()):
        """Relocalizes a robot that stands ``x`` metres before a vertex and sees what is seen there."""
        T_world_live = self.poses[at] @ geometry.from_xy_yaw(x, 0.05, 0.02)
        relocalizer = Relocalizer(
            self.index,
            self.graph,
            self.search,
            lambda vertices: {v: v for v in vertices if v not in missing},
        )
        return relocalizer.find((T_world_live, places or {}), {"plain": self.looks[at]})
