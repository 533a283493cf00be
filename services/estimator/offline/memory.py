"""A map store in memory: what a teach and the repeats of a route leave behind, without a bus."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from common.geometry import Array, Uncertain
from common.ids import VertexId, new_map_id
from common.messages import Commit, MapRecord
from common.posegraph import Edge, PoseGraph
from services.estimator.stereo.pipeline import StereoPipeline
from services.estimator.stereo.submap import StereoSubmap

ENVIRONMENT = "offline"


@dataclass(slots=True)
class Memory:
    """A pose graph with its submaps.

    Attributes:
        graph: every map so far; the first one is the taught route.
        submaps: of every vertex.
        truth: true pose ``T_world_left`` (4, 4) of every vertex where it is known.
    """

    graph: PoseGraph = field(default_factory=lambda: PoseGraph(ENVIRONMENT))
    submaps: dict[VertexId, StereoSubmap] = field(default_factory=dict)
    truth: dict[VertexId, Array] = field(default_factory=dict)

    @property
    def route(self) -> list[VertexId]:
        """The taught vertices in driving order."""
        return self.graph.vertices(next(iter(self.graph.experiences))) if self.graph.experiences else []

    def record(self, stamp: int) -> MapRecord:
        """The record of the next map, made at ``stamp``: taught if it is the first, else recorded in a repeat."""
        taught = next(iter(self.graph.experiences), None)
        return MapRecord(
            id=new_map_id(ENVIRONMENT, stamp),
            environment=ENVIRONMENT,
            stamp=stamp,
            robot=ENVIRONMENT,
            sensor="stereo",
            generation=0 if taught is None else 1,
            parent=taught,
        )

    def add(self, commit: Commit, pipeline: StereoPipeline, T_world_left: Array | None) -> None:
        """Takes what a recorder wants to be stored.

        Raises:
            GraphError: it contradicts the graph.
        """
        if commit.map is not None:
            self.graph.add_experience(commit.map)
        if commit.vertex is not None:
            vertex = commit.vertex.id
            self.graph.add_vertex(vertex)
            self.submaps[vertex] = pipeline.read(commit.vertex)
            if T_world_left is not None:
                self.truth[vertex] = np.asarray(T_world_left)
        for edge in commit.edges:
            self.graph.add_edge(Edge(edge.a, edge.b, Uncertain(edge.T_a_b, edge.covariance), edge.kind == "spatial"))
