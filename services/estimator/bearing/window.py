"""How alike the live image and the stored ones are at any distance along the map and any heading offset."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from common.geometry import Array


@dataclass(frozen=True, slots=True)
class TaughtPath:
    """The taught way as wheels know it: N vertices at distances ``metres`` (N,), ascending, with headings ``yaw`` (N,).

    Headings are unwrapped, so that differences along the way are turns. ``direction`` (N - 1,) is 1 where the robot
    drove forwards from a vertex to the next, -1 where backwards.
    """

    metres: Array
    yaw: Array
    direction: Array

    @property
    def length(self) -> float:
        """Metres from the first vertex to the last."""
        return float(self.metres[-1])

    def yaw_at(self, metres: Array) -> Array:
        """The taught heading (K,) at distances (K,) along the map; beyond its ends, that of the end."""
        return np.interp(metres, self.metres, self.yaw)

    def direction_at(self, metres: float) -> float:
        """1 where the way goes forwards at a distance, else -1."""
        if len(self.direction) == 0:
            return 1.0
        step = int(np.searchsorted(self.metres, metres, side="right")) - 1
        return float(self.direction[min(max(step, 0), len(self.direction) - 1)])


@dataclass(frozen=True, slots=True)
class Window:
    """K stored images around the robot, compared with the live one.

    Attributes:
        metres: (K,) their distances along the map, ascending.
        yaw: (K,) taught headings there, radians.
        curves: (K, M) similarity of the live image to each, equation 3.4 of the thesis, at M shifts about 0.
        step: radians of heading between two shifts; the scene lies further right the further left the robot looks.
        reach: see :class:`services.estimator.bearing.settings.ParticleSettings`.
    """

    metres: Array
    yaw: Array
    curves: Array
    step: float
    reach: float

    def similarity(self, metres: Array, heading: Array) -> Array:
        """Similarity at distances along the map and robot's headings, both (P,), on the taught path's scale of yaw.

        Between two stored images it is interpolated by distance, and each is compared at its own shift, so that a robot
        that is on its way through a curve is expected to see both turned. Beyond the outermost images it fades out.
        """
        last = len(self.metres) - 1
        after = np.clip(np.searchsorted(self.metres, metres), 1, max(last, 1)).astype(np.int64)
        lower, upper = np.minimum(after - 1, last), np.minimum(after, last)
        gap = np.maximum(self.metres[upper] - self.metres[lower], 1e-6)
        share = np.clip((metres - self.metres[lower]) / gap, 0.0, 1.0)
        value = (1.0 - share) * self._at(lower, heading) + share * self._at(upper, heading)
        beyond = metres - np.clip(metres, self.metres[0], self.metres[-1])
        return np.asarray(value * np.exp(-0.5 * (beyond / self.reach) ** 2))

    def contrast(self, similarity: float) -> float:
        """By how many standard deviations a similarity stands out of that at all shifts of all images."""
        return float((similarity - self.curves.mean()) / max(float(self.curves.std()), 1e-9))

    def _at(self, image: NDArray[np.int64], heading: Array) -> Array:
        """The curve of each particle's image (P,) at each one's heading, interpolated; 0 beyond the largest shift."""
        count = self.curves.shape[1]
        place = (heading - self.yaw[image]) / self.step + count // 2
        left = np.clip(np.floor(place).astype(np.int64), 0, count - 2)
        share = place - left
        value = (1.0 - share) * self.curves[image, left] + share * self.curves[image, left + 1]
        return np.where((share >= 0.0) & (share <= 1.0), value, 0.0)
