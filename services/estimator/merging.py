"""Loop closure while a map is taught: frames are localized against vertices that the operator expects nearby.

VT&R3's *Merge*: the candidates are tried in turn. Two frames that agree on where one of them lies make an offer, which
the operator confirms; nothing is joined before.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np

from common import geometry
from common.geometry import Uncertain
from common.ids import VertexId
from common.messages import EdgeRecord, LoopClosure
from services.estimator.experience import Place
from services.estimator.pipeline import Pipeline, Step

Live = TypeVar("Live")
Submap = TypeVar("Submap")


@dataclass(frozen=True, slots=True)
class ClosureSettings:
    """When a loop closure is offered.

    Attributes:
        inliers: landmarks that must agree, in each of two frames.
        agree_m, agree_rad: the two agree within these.
    """

    inliers: int = 30
    agree_m: float = 0.15
    agree_rad: float = 0.05


class ClosureSearch(Generic[Live, Submap]):
    """Looks for one of some candidates from the map that is being taught."""

    def __init__(
        self,
        candidates: Sequence[VertexId],
        pipeline: Pipeline[Live, Submap],
        submap: Callable[[VertexId], Submap | None],
        settings: ClosureSettings,
    ) -> None:
        self.candidates = tuple(candidates)
        self._pipeline = pipeline
        self._submap = submap
        self._settings = settings
        self._turn = 0
        self._found: tuple[VertexId, Uncertain] | None = None

    def look(self, last: Place, step: Step[Live]) -> LoopClosure | None:
        """Tries one candidate with a frame; ``last`` is the taught map's last vertex, and the robot in its frame.

        Returns a loop closure once two frames agree on one.
        """
        candidate = self._next()
        submap = self._submap(candidate)
        if submap is None:
            return None
        result = self._pipeline.search(submap, step.live)
        before, self._found = self._found, None
        if not result.success or result.inliers < self._settings.inliers:
            return None
        vertex, T_last_live = last
        T_live_candidate = result.T_vertex_live.inverse()
        T_last_candidate = T_last_live @ T_live_candidate
        # By the live frame, not by the last vertex: another one may come between two frames.
        self._found = candidate, T_live_candidate
        if before is None or before[0] != candidate or not self._agree(before[1], T_live_candidate, step):
            return None
        edge = EdgeRecord(
            kind="spatial", a=vertex, b=candidate, T_a_b=T_last_candidate.T, covariance=T_last_candidate.covariance
        )
        return LoopClosure(stamp=step.stamp, edge=edge, inliers=result.inliers)

    def _next(self) -> VertexId:
        """The candidate that was found by the last frame, else the next in turn."""
        if self._found is not None:
            return self._found[0]
        self._turn += 1
        return self.candidates[self._turn % len(self.candidates)]

    def _agree(self, before: Uncertain, now: Uncertain, step: Step[Live]) -> bool:
        """Whether the candidate lies, seen from this frame, where the frame before saw it, by the odometry between."""
        expected = geometry.inverse(step.T_last_live.T) @ before.T
        difference = geometry.inverse(expected) @ now.T
        near = float(np.linalg.norm(difference[:3, 3])) < self._settings.agree_m
        return near and float(geometry.rotation_angle(difference)) < self._settings.agree_rad
