"""Relocalisation without a prior: retrieval by appearance over all vertices, then metric verification of the best.

A place counts only where its landmarks agree on a pose, a vertex beside it agrees on the same pose by itself, and no
other place fits nearly as well.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np

from common import geometry
from common.geometry import Uncertain
from common.ids import VertexId
from common.posegraph import PoseGraph
from services.estimator.pipeline import Localized
from services.estimator.relocalization.appearance import Appearance
from services.estimator.relocalization.index import AppearanceIndex
from services.estimator.relocalization.settings import RelocalizationSettings

Live = TypeVar("Live")
Submap = TypeVar("Submap")

_ROTATION_WEIGHT = 0.5
"""Metres that a radian counts for where vertices are compared by their distance."""

_BATCH = 4
"""Submaps that are fetched at once: the first few nearly always tell."""

_MOST_AROUND = 3000
"""Vertices around a place that are looked at, however many experiences pass it."""


@dataclass(frozen=True, slots=True)
class Found:
    """Where the robot stands.

    Attributes:
        vertex: the taught vertex nearest to it; one that a repeat recorded where no taught one is near.
        T_vertex_live: the vehicle in its frame, with covariance.
        inliers: landmarks that agree.
        stream: the images that they are of.
    """

    vertex: VertexId
    T_vertex_live: Uncertain
    inliers: int
    stream: str


@dataclass(frozen=True, slots=True)
class NotFound:
    """Why the robot does not know where it stands, in one sentence."""

    reason: str


@dataclass(frozen=True, slots=True)
class _Candidate:
    """A vertex that looks like what the camera sees, and how much, by the index's score."""

    vertex: VertexId
    score: float


@dataclass(frozen=True, slots=True)
class _Fit:
    """A vertex against which the frame was localized."""

    vertex: VertexId
    result: Localized


class Relocalizer(Generic[Live, Submap]):
    """Finds a frame among the vertices of an index and of a pose graph.

    ``search`` localizes a frame against a submap without a prior, and ``submaps_of`` fetches the submaps of some
    vertices, as many of them as can be had.
    """

    def __init__(
        self,
        index: AppearanceIndex,
        graph: PoseGraph,
        search: Callable[[Submap, Live], Localized],
        submaps_of: Callable[[Sequence[VertexId]], Mapping[VertexId, Submap]],
        settings: RelocalizationSettings | None = None,
    ) -> None:
        self._index = index
        self._graph = graph
        self._search = search
        self._submaps_of = submaps_of
        self._settings = settings or RelocalizationSettings()

    def find(self, live: Live, appearance: Appearance) -> Found | NotFound:
        """Where a frame was taken, by the frame and by what it looks like."""
        if not any(len(found) for found in appearance.values()):
            return NotFound("the camera sees nothing that could be recognised")
        candidates = self._candidates(appearance)
        if not candidates:
            return NotFound(f"nothing in environment '{self._graph.environment}' looks like what the camera sees")
        fits = self._verified(candidates, live)
        if not fits:
            return NotFound(f"none of the {len(candidates)} places that look most alike fits what the camera sees")
        best = max(fits, key=lambda fit: fit.result.inliers)
        around = self._graph.window(best.vertex, _MOST_AROUND, self._settings.reach)
        agreeing = [fit for fit in fits if fit is not best and self._agree(best, fit, around)]
        rival = self._rival(best, [fit for fit in fits if fit is not best and fit not in agreeing])
        if rival is not None:
            return NotFound(
                f"two places look alike: {best.vertex} with {best.result.inliers} landmarks that agree, and "
                f"{rival.vertex} with {rival.result.inliers}"
            )
        if not agreeing and not self._is_confirmed(best, around, live):
            return NotFound(f"{best.vertex} fits what the camera sees, but no vertex beside it does")
        return self._in_taught_frame(best, around)

    def _candidates(self, appearance: Appearance) -> list[_Candidate]:
        """The vertices that look most like it, the likest first, each of another place."""
        chosen: list[_Candidate] = []
        taken: set[VertexId] = set()
        for vertex, score in self._index.rank(appearance):
            if vertex in taken or vertex not in self._graph:
                continue
            chosen.append(_Candidate(vertex, score))
            if len(chosen) == self._settings.candidates:
                break
            taken |= self._graph.within(vertex, self._settings.place_radius).keys()
        return chosen

    def _verified(self, candidates: Sequence[_Candidate], live: Live) -> list[_Fit]:
        """The candidates that fit, up to where they look too unlike the first of them to be its rivals."""
        scores = {candidate.vertex: candidate.score for candidate in candidates}
        found: list[_Fit] = []
        for start in range(0, len(candidates), _BATCH):
            batch = [candidate.vertex for candidate in candidates[start : start + _BATCH]]
            submaps = self._submaps_of(batch)
            for vertex in batch:
                if found and scores[vertex] < self._settings.rival_likeness * scores[found[0].vertex]:
                    return found
                found += self._fit(vertex, submaps, live)
        return found

    def _fit(self, vertex: VertexId, submaps: Mapping[VertexId, Submap], live: Live) -> list[_Fit]:
        """The frame's localization against a vertex; none where it fails, or the submap is not to be had."""
        if vertex not in submaps:
            return []
        result = self._search(submaps[vertex], live)
        return [_Fit(vertex, result)] if result.success else []

    def _agree(self, best: _Fit, other: _Fit, around: Mapping[VertexId, Uncertain]) -> bool:
        """Whether two vertices tell the same pose of the robot."""
        if other.vertex not in around:
            return False
        told = around[other.vertex].T @ other.result.T_vertex_live.T
        error = geometry.inverse(best.result.T_vertex_live.T) @ told
        metres, radians = float(np.linalg.norm(error[:3, 3])), float(geometry.rotation_angle(error))
        return metres <= self._settings.agreement and radians <= _ROTATION_WEIGHT * self._settings.agreement

    def _rival(self, best: _Fit, others: Sequence[_Fit]) -> _Fit | None:
        """The best of the others, where the frame was taken there nearly as likely."""
        rival = max(others, key=lambda fit: fit.result.inliers, default=None)
        if rival is None or rival.result.inliers < self._settings.rival * best.result.inliers:
            return None
        return rival

    def _is_confirmed(self, best: _Fit, around: Mapping[VertexId, Uncertain], live: Live) -> bool:
        """Whether one of the vertices nearest to the robot agrees; true of a vertex that stands alone."""
        distance = self._distances(best, around)
        beside = sorted((v for v in around if v != best.vertex), key=distance.__getitem__)
        if not beside:
            return True
        nearest = beside[: self._settings.neighbours]
        submaps = self._submaps_of(nearest)
        return any(self._agree(best, fit, around) for vertex in nearest for fit in self._fit(vertex, submaps, live))

    def _in_taught_frame(self, best: _Fit, around: Mapping[VertexId, Uncertain]) -> Found:
        """The pose in the taught vertex nearest to the robot."""
        distance = self._distances(best, around)
        taught = [v for v in around if self._graph.privileged(v)]
        vertex = min(taught or [best.vertex], key=distance.__getitem__)
        pose = around[vertex].inverse() @ best.result.T_vertex_live
        return Found(vertex, pose, best.result.inliers, best.result.stream)

    @staticmethod
    def _distances(best: _Fit, around: Mapping[VertexId, Uncertain]) -> dict[VertexId, float]:
        """How far the robot is from each vertex around, its turn included."""
        T_vertices_live = geometry.inverse(np.array([T.T for T in around.values()])) @ best.result.T_vertex_live.T
        metres = np.linalg.norm(T_vertices_live[:, :3, 3], axis=1)
        total = metres + _ROTATION_WEIGHT * geometry.rotation_angle(T_vertices_live)
        return dict(zip(around, total.tolist(), strict=True))
