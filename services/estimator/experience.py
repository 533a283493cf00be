"""Recording an experience: vertices joined by temporal edges, as commits for the map store."""

from __future__ import annotations

from typing import Generic, TypeVar

import numpy as np

from common.geometry import Uncertain
from common.ids import VertexId
from common.messages import Commit, EdgeRecord, MapRecord, VertexRecord
from services.estimator.pipeline import Pipeline, Step

Live = TypeVar("Live")
Submap = TypeVar("Submap")

_LAST_VERTEX_M = 0.05
"""The robot's place at the end of a teach becomes a vertex unless the last one is nearer than this."""


class ExperienceRecorder(Generic[Live, Submap]):
    """One map while it is driven.

    ``joined`` is the vertex of another map that the first vertex is localized against, with ``T_joined_live``; or,
    where a recording is taken up again, ``last`` is the map's last vertex with ``T_last_live``.
    """

    def __init__(
        self,
        record: MapRecord,
        pipeline: Pipeline[Live, Submap],
        *,
        joined: tuple[VertexId, Uncertain] | None = None,
        last: tuple[VertexId, Uncertain] | None = None,
    ) -> None:
        self.record = record
        self._pipeline = pipeline
        self._joined = joined
        self._last = last

    @property
    def last(self) -> tuple[VertexId, Uncertain] | None:
        """The newest vertex, and the live frame in it."""
        return self._last

    def step(self, step: Step[Live]) -> Commit | None:
        """Takes a frame; returns the commit of a new vertex where one is due."""
        if self._last is None:
            return self._first(step) if step.success else None
        vertex, T_vertex_last = self._last
        T_vertex_live = T_vertex_last @ step.T_last_live
        self._last = vertex, T_vertex_live
        if not step.success or not self._pipeline.is_vertex_due(T_vertex_live.T, step.inliers):
            return None
        return self._next(step)

    def finish(self, step: Step[Live] | None) -> Commit:
        """The last commit: a vertex where the robot stands, unless the last one is there, and the map's end."""
        commit = Commit()
        if step is not None and step.success and self._last is not None:
            distance = float(np.linalg.norm(self._last[1].T[:3, 3]))
            if distance >= _LAST_VERTEX_M:
                commit = self._next(step)
        return commit.model_copy(update={"finished": self.record.id})

    def _first(self, step: Step[Live]) -> Commit:
        vertex = VertexId(self.record.id, 0)
        edges = []
        if self._joined is not None:
            joined, T_joined_live = self._joined
            edges = [_edge("spatial", joined, vertex, T_joined_live)]
        self._last = vertex, Uncertain.identity()
        return Commit(map=self.record, vertex=self._vertex(vertex, step), edges=edges)

    def _next(self, step: Step[Live]) -> Commit:
        assert self._last is not None  # noqa: S101, a first vertex exists
        previous, T_previous_live = self._last
        vertex = VertexId(self.record.id, previous.index + 1)
        self._last = vertex, Uncertain.identity()
        edge = _edge("temporal", previous, vertex, T_previous_live)
        return Commit(vertex=self._vertex(vertex, step), edges=[edge])

    def _vertex(self, vertex: VertexId, step: Step[Live]) -> VertexRecord:
        return VertexRecord(id=vertex, stamp=step.stamp, keyframe=self._pipeline.keyframe(step.live))


def _edge(kind: str, a: VertexId, b: VertexId, T_a_b: Uncertain) -> EdgeRecord:
    return EdgeRecord.model_validate({"kind": kind, "a": a, "b": b, "T_a_b": T_a_b.T, "covariance": T_a_b.covariance})
