"""Recording an experience: vertices joined by temporal edges, as commits for the map store."""

from __future__ import annotations

from typing import Generic, TypeVar

import numpy as np

from common.geometry import Uncertain
from common.ids import VertexId
from common.messages import Commit, EdgeRecord, MapRecord, VertexRecord
from services.estimator.pipeline import Pipeline, Step
from services.estimator.reckoning import DeadReckoning

Live = TypeVar("Live")
Submap = TypeVar("Submap")

Place = tuple[VertexId, Uncertain]
"""A vertex, and the live frame in it."""

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
        joined: Place | None = None,
        last: Place | None = None,
    ) -> None:
        self.record = record
        self._pipeline = pipeline
        self._joined = joined
        self._T_last_live = DeadReckoning()
        self._last: VertexId | None = None
        if last is not None:
            self._last = last[0]
            self._T_last_live.start(last[1])

    @property
    def last(self) -> Place | None:
        """The newest vertex, and the live frame in it."""
        return None if self._last is None else (self._last, self._T_last_live.T_reference_live)

    def move(self, step: Step[Live]) -> None:
        """Takes a frame along that no vertex is made of."""
        self._T_last_live.move(step)

    def step(self, step: Step[Live], localized: Place | None = None) -> Commit | None:
        """Takes a frame; returns the commit of a new vertex where one is due.

        ``localized`` is the vertex of another map that this very frame was localized against, if it was: a spatial edge
        then joins the two.
        """
        self.move(step)
        if self._last is None:
            return self._first(step, self._joined if localized is None else localized) if step.success else None
        T_vertex_live = self._T_last_live.T_reference_live.T
        if not step.success or not self._pipeline.is_vertex_due(T_vertex_live, step.inliers):
            return None
        return self._next(step, localized)

    def finish(self, step: Step[Live] | None) -> Commit:
        """The last commit: a vertex where the robot stands, unless the last one is there, and the map's end."""
        commit = Commit()
        if step is not None and step.success and self.last is not None:
            distance = float(np.linalg.norm(self.last[1].T[:3, 3]))
            if distance >= _LAST_VERTEX_M:
                commit = self._next(step, None)
        return commit.model_copy(update={"finished": self.record.id})

    def _first(self, step: Step[Live], joined: Place | None) -> Commit:
        vertex = VertexId(self.record.id, 0)
        edges = [] if joined is None else [_edge("spatial", joined[0], vertex, joined[1])]
        self._move_to(vertex)
        return Commit(map=self.record, vertex=self._vertex(vertex, step), edges=edges)

    def _next(self, step: Step[Live], localized: Place | None) -> Commit:
        assert self._last is not None  # noqa: S101, a first vertex exists
        vertex = VertexId(self.record.id, self._last.index + 1)
        edges = [_edge("temporal", self._last, vertex, self._T_last_live.T_reference_live)]
        if localized is not None:
            edges.append(_edge("spatial", localized[0], vertex, localized[1]))
        self._move_to(vertex)
        return Commit(vertex=self._vertex(vertex, step), edges=edges)

    def _move_to(self, vertex: VertexId) -> None:
        """The live frame becomes the newest vertex."""
        self._last = vertex
        self._T_last_live.start()

    def _vertex(self, vertex: VertexId, step: Step[Live]) -> VertexRecord:
        return VertexRecord(id=vertex, stamp=step.stamp, keyframe=self._pipeline.keyframe(step.live))


def _edge(kind: str, a: VertexId, b: VertexId, T_a_b: Uncertain) -> EdgeRecord:
    return EdgeRecord.model_validate({"kind": kind, "a": a, "b": b, "T_a_b": T_a_b.T, "covariance": T_a_b.covariance})
