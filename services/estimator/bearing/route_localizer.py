"""Bearing-only localization along a route: a particle filter beside the chain, which keeps trunk, branch and leaf.

``T_trunk_robot`` says what is known: x is metres along the way from the trunk, yaw the robot's heading by the shift of
the images (radians by the camera's rough field of view), y is 0, for nothing measures it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from common import geometry
from common.errors import ImageError
from common.geometry import Array, Uncertain
from common.ids import VertexId
from services.estimator.bearing.actions import along
from services.estimator.bearing.comparison import BearingLive, Comparison
from services.estimator.bearing.particles import ParticleFilter
from services.estimator.bearing.pipeline import STREAM, covariance_of
from services.estimator.bearing.settings import BearingSettings
from services.estimator.bearing.submap import BearingSubmap
from services.estimator.bearing.window import TaughtPath, Window
from services.estimator.chain import ChainSettings
from services.estimator.pipeline import Localized, Pipeline, Step
from services.estimator.route_localizer import RouteLocalizer, WindowSettings
from services.estimator.route_map import RouteMap

_GRID_M = 0.1
_GRID_RAD = 0.01
_SPREAD = 2.5
"""Standard deviations of the particles to either side whose images are looked at."""
_FEW = 2
"""Images without which nothing can be told of the distance."""


@dataclass(frozen=True, slots=True)
class _Grid:
    """Places that are tried: distances along the map (S,) and heading offsets (H,)."""

    metres: Array
    headings: Array

    @classmethod
    def around(cls, here: float, reach: float, largest: float, end: float) -> _Grid:
        """Distances about one, up to the end of what is looked at, and offsets to either side."""
        metres = np.arange(here - reach, here + reach + _GRID_M / 2.0, _GRID_M)
        return cls(np.minimum(metres, end), np.arange(-largest, largest + _GRID_RAD / 2.0, _GRID_RAD))

    def similarity(self, window: Window, taught: TaughtPath) -> Array:
        """Similarity (S, H) at each place."""
        metres = np.repeat(self.metres, len(self.headings))
        offsets = np.tile(self.headings, len(self.metres))
        return window.similarity(metres, taught.yaw_at(metres) + offsets).reshape(len(self.metres), -1)


class BearingRouteLocalizer(RouteLocalizer[BearingLive, BearingSubmap]):
    """Keeps the robot located by distance and heading on a route with poses ``path`` (N, 4, 4) by the wheels."""

    metric: ClassVar[bool] = False

    def __init__(
        self,
        route_map: RouteMap[BearingLive, BearingSubmap],
        path: Array,
        pipeline: Pipeline[BearingLive, BearingSubmap],
        chain: ChainSettings,
        window: WindowSettings,
        settings: BearingSettings,
        comparison: Comparison,
        seed: int = 0,
    ) -> None:
        super().__init__(route_map, path, pipeline, chain, window)
        self._comparison = comparison
        self._bearing = settings
        self._taught = _taught(path)
        self._particles = ParticleFilter(settings.particles, seed)
        self._since_weighed = 0.0

    def start(self, target: VertexId | None) -> None:
        """Expects the robot within a few metres of a vertex of the route, or of its first."""
        super().start(target)
        self._particles.start(float(self._taught.metres[self.chain.trunk]), 0.0, (self._bearing.search, 0.1))

    def move(self, step: Step[BearingLive]) -> None:
        """Takes a frame's wheel odometry along without looking at its image."""
        super().move(step)
        if not step.success:
            unknown = np.sqrt(np.diagonal(step.T_last_live.covariance))
            self._particles.blur(float(unknown[0]), float(unknown[5]))
            self._since_weighed += float(unknown[0])
            return
        direction = self._taught.direction_at(self._particles.estimate().metres)
        self._particles.predict(direction * step.live.metres, step.live.turn, self._taught.yaw_at)
        self._since_weighed += abs(step.live.metres)

    def follow(self, step: Step[BearingLive]) -> Localized:
        """Weighs the particles by a frame's image, whose wheel odometry was taken."""
        if not step.success:
            return self._missing(step.reason)
        before = self._particles.estimate()
        reach = max(_SPREAD * before.sigmas[0], self._bearing.distance)
        window = self._images_between(step.live, before.metres - reach, before.metres + reach)
        if isinstance(window, str):
            return self._missing(window)
        particles = self._particles
        anywhere = _Grid.around(before.metres, reach, self._bearing.search_heading, self._taught.length)
        particles.sprinkle(
            anywhere.metres,
            anywhere.headings,
            anywhere.similarity(window, self._taught),
            self._bearing.particles.fresh * self._since_weighed,
        )
        headings = self._taught.yaw_at(particles.metres) + particles.heading
        similarity = window.similarity(particles.metres, headings)
        contrast = window.contrast(float(similarity.max()))
        if contrast < self._bearing.least_contrast:
            return self._missing(f"what the camera sees is not like the map ({contrast:.1f} sigma)")
        particles.weigh(similarity, self._since_weighed)
        self._since_weighed = 0.0
        return self._located(self._bearing.lost_sigma)

    def search(self, step: Step[BearingLive]) -> Localized:
        """Looks for the robot a few metres around the vertex that it was started at, all the time from one image."""
        if len(self.map.vertices) == 1:
            return super().search(step)
        if self.chain.localized:
            result = self.follow(step)
            if result.success:
                return result
        s, here = self._bearing, float(self._taught.metres[self.chain.trunk])
        window = self._images_between(step.live, here - s.search, here + s.search, every=True)
        if isinstance(window, str):
            return self._missing(window)
        grid = _Grid.around(here, s.search, s.search_heading, self._taught.length + s.search)
        similarity = grid.similarity(window, self._taught)
        contrast = window.contrast(float(similarity.max()))
        if contrast < s.least_contrast:
            return self._missing(f"no image around the start is like what the camera sees ({contrast:.1f} sigma)")
        # A start is named because the robot is near it: a normal prior, as the logarithm of a likelihood.
        prior = -0.5 * s.particles.temperature * ((grid.metres - here) / (0.5 * s.search)) ** 2
        self._particles.spread(grid.metres, grid.headings, similarity + prior[:, None])
        self._since_weighed = 0.0
        return self._located(s.search_sigma)

    def actions(self) -> Array | None:
        """Taught actions (K, 3) ``[metres ahead of the robot, v, w]``."""
        s, here = self._bearing, self._particles.estimate().metres
        around = range(*np.searchsorted(self._taught.metres, [here - s.actions_behind, here + s.actions_ahead]))
        first, last = max(around.start - 2, 0), min(around.stop + 2, len(self.map.vertices))
        found = [self.map.own(index) for index in range(first, last)]
        rows = along(
            [None if submap is None else submap.first.actions for submap in found], self._taught.metres[first:last]
        )
        rows[:, 0] -= here
        near = rows[(rows[:, 0] >= -s.actions_behind) & (rows[:, 0] <= s.actions_ahead)]
        return near if len(near) else rows[np.argsort(np.abs(rows[:, 0]))[:1]]

    def _located(self, limit: float) -> Localized:
        """The chain at the particles' estimate, where it is sharp enough."""
        found = self._particles.estimate()
        distance, heading = found.sigmas
        if not distance <= limit:
            return self._missing(f"the images fit anywhere within {distance:.1f} m (1 sigma) along the map")
        taught = self._taught
        trunk = int(np.argmin(np.abs(taught.metres - found.metres)))
        turn = float(taught.yaw_at(np.array([found.metres]))[0]) - float(taught.yaw[trunk]) + found.heading
        T = geometry.from_xy_yaw(found.metres - float(taught.metres[trunk]), 0.0, turn)
        estimate = Uncertain(T, covariance_of(distance, heading))
        self.chain.trunk = trunk
        self.chain.localize(estimate)
        # The distance along the way decides on the trunk, not that in the plane, which nothing measures.
        self.chain.trunk = trunk
        return Localized(success=True, T_vertex_live=estimate, inliers=0, stream=STREAM, reason="")

    def _images_between(self, live: BearingLive, first: float, last: float, *, every: bool = False) -> Window | str:
        """The stored images between two distances and one to either side, compared with the live one; or why not."""
        metres = self._taught.metres
        begin = max(int(np.searchsorted(metres, first, side="right")) - 1, 0)
        end = min(int(np.searchsorted(metres, last)) + 1, len(metres))
        begin = min(begin, len(metres) - 1)
        indices = np.arange(begin, max(end, begin + 1))
        if not every and len(indices) > self._bearing.images:
            indices = indices[np.linspace(0, len(indices) - 1, self._bearing.images).round().astype(int)]
        found = [(i, submap) for i in indices if (submap := self.map.own(int(i))) is not None]
        if len(found) < min(_FEW, len(indices)) or (every and len(found) < len(indices)):
            return "the map's images are not here yet"
        try:
            results = [self._comparison.compare(live, submap.first) for _, submap in found]
        except ImageError as error:
            return str(error)
        at = np.array([i for i, _ in found])
        step = float(results[0].shifts_px[1] - results[0].shifts_px[0]) * self._comparison.radians_per_pixel(live)
        curves = np.stack([result.curve for result in results])
        return Window(metres[at], self._taught.yaw[at], curves, step, self._bearing.particles.reach)


def _taught(path: Array) -> TaughtPath:
    steps = geometry.inverse(path[:-1]) @ path[1:]
    direction = np.where(steps[:, 0, 3] < 0.0, -1.0, 1.0)
    yaw = np.concatenate([[0.0], np.cumsum(geometry.yaw_of(steps))])
    return TaughtPath(geometry.arclength(path), yaw, direction)
