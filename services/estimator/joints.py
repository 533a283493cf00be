"""Where the next map of a plan joins a route's end, found on the way: two maps meet that no edge joins.

Both maps end and begin at one named place, so the next map's first vertices are expected about the route's last one.
Approaching that, each frame that was localized on the route is localized against one of them as well, by the sensor's
own localization with that wide prior. Two frames that agree make a spatial edge.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

import numpy as np

from common import geometry
from common.geometry import Uncertain
from common.ids import VertexId
from common.messages import EdgeRecord
from services.estimator.pipeline import Pipeline, Step
from services.estimator.reckoning import DeadReckoning
from services.estimator.route_localizer import RouteLocalizer

Live = TypeVar("Live")
Submap = TypeVar("Submap")


@dataclass(frozen=True, slots=True)
class JointSettings:
    """How the next map is looked for.

    Attributes:
        ahead: metres before the route's end from which on it is.
        vertices: so many of its first ones are tried.
        spacing: metres that these are assumed to lie apart.
        distance, rotation: standard deviations (m, rad) of where its beginning is expected about the route's end.
        every: frames from one try to the next, for a frame has to be through within its period.
        inliers: landmarks that must agree.
        agree_m, agree_rad: two tries agree within these.
        reach: metres from the route's end within which the next map may begin.
        behind: metres that a robot may have moved from the route's end for an edge from there, found at a standstill.
    """

    ahead: float = 10.0
    vertices: int = 4
    spacing: float = 0.4
    distance: float = 1.0
    rotation: float = 0.15
    every: int = 2
    inliers: int = 30
    agree_m: float = 0.15
    agree_rad: float = 0.05
    reach: float = 8.0
    behind: float = 4.0


@dataclass(frozen=True, slots=True)
class _Try:
    """A vertex of the next map that a frame was localized against, and where it lies: ``T_last_vertex``."""

    vertex: VertexId
    T_last_vertex: Uncertain


class JointSearch(Generic[Live, Submap]):
    """Looks for the first vertices of the map that comes after a route whose last vertex is ``last``."""

    def __init__(
        self,
        last: VertexId,
        next_map: str,
        pipeline: Pipeline[Live, Submap],
        submap: Callable[[VertexId], Submap | None],
        settings: JointSettings,
    ) -> None:
        self.last = last
        self.next_map = next_map
        self._pipeline = pipeline
        self._submap = submap
        self._settings = settings
        self._candidates = [VertexId(next_map, index) for index in range(settings.vertices)]
        self._turn = 0
        self._first: _Try | None = None
        self._done = False

    def wanted(self, localizer: RouteLocalizer[Live, Submap]) -> list[VertexId]:
        """Vertices whose submaps are needed."""
        return self._candidates if self._is_near(localizer) else []

    def look(self, localizer: RouteLocalizer[Live, Submap], step: Step[Live]) -> EdgeRecord | None:
        """Tries one vertex with a frame that was localized on the route; returns the edge when it is found."""
        self._turn += 1
        if not self._is_near(localizer) or self._turn % self._settings.every:
            return None
        vertex = self._candidates[self._turn // self._settings.every % len(self._candidates)]
        if self._first is not None:
            vertex = self._first.vertex
        submap = self._submap(vertex)
        if submap is None:
            return None
        T_last_live = localizer.T_end_leaf()
        found = self._tried(vertex, submap, T_last_live, step)
        edge = None
        if found is not None and self._first is not None and self._agree(self._first, found):
            self._done = True
            T = found.T_last_vertex
            edge = EdgeRecord(kind="spatial", a=self.last, b=vertex, T_a_b=T.T, covariance=T.covariance)
        self._first = found
        return edge

    def _is_near(self, localizer: RouteLocalizer[Live, Submap]) -> bool:
        return not self._done and localizer.chain.localized and localizer.metres_left() < self._settings.ahead

    def _tried(self, vertex: VertexId, submap: Submap, T_last_live: Uncertain, step: Step[Live]) -> _Try | None:
        """Where a vertex lies by a frame; None where the frame was not localized there, or it lies too far away."""
        s = self._settings
        if self._first is None:
            along = geometry.from_xy_yaw(s.spacing * vertex.index, 0.0, 0.0)
            sigma = np.repeat([s.distance, s.rotation], 3)
            expected = Uncertain(along, np.diag(sigma**2))
        else:
            expected = self._first.T_last_vertex
        prior = expected.inverse() @ T_last_live
        result = self._pipeline.localize(submap, prior, step.live)
        if not result.success or result.inliers < s.inliers:
            return None
        T_last_vertex = T_last_live @ result.T_vertex_live.inverse()
        if np.linalg.norm(T_last_vertex.T[:3, 3]) > s.reach:
            return None
        return _Try(vertex, T_last_vertex)

    def _agree(self, one: _Try, other: _Try) -> bool:
        difference = geometry.inverse(one.T_last_vertex.T) @ other.T_last_vertex.T
        near = float(np.linalg.norm(difference[:3, 3])) < self._settings.agree_m
        return near and float(geometry.rotation_angle(difference)) < self._settings.agree_rad


class JointBehind:
    """The end of the route that a robot has left, by dead reckoning, until it finds itself on the next map."""

    def __init__(self, last: VertexId, T_last_live: Uncertain, settings: JointSettings) -> None:
        self.last = last
        self._settings = settings
        self._T_last_live = DeadReckoning()
        self._T_last_live.start(T_last_live)

    def move(self, step: Step[Any]) -> None:
        """Takes a frame's odometry."""
        self._T_last_live.move(step)

    def edge(self, vertex: VertexId, T_vertex_live: Uncertain) -> EdgeRecord | None:
        """The edge to a vertex that the robot was localized against; None where it has driven too far since."""
        T_last_live = self._T_last_live.T_reference_live
        if float(np.linalg.norm(T_last_live.T[:3, 3])) > self._settings.behind or vertex.map_id == self.last.map_id:
            return None
        T = T_last_live @ T_vertex_live.inverse()
        return EdgeRecord(kind="spatial", a=self.last, b=vertex, T_a_b=T.T, covariance=T.covariance)
