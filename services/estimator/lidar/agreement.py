"""What the ranges of a scan say to a pose: whether the map's landmarks are where it puts them.

A false pose can find as many similar keypoints as the true one, above all among what moves with the vehicle: what it
hides of the ground from its own lidar. But it looks through walls. Every landmark is a witness here, whether it was
found again or not.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from common.compiled import kernel
from services.estimator.lidar.images import ImageStack

Array = NDArray[np.float64]

_BINS = 4096
"""Parts of a circle in which the column of an azimuth is looked up."""
_TOLERANCE = (0.1, 0.01)
"""How far from the ranges around it a landmark still lies on their surface: metres, and a part of its range."""


@dataclass(frozen=True, slots=True)
class RangeImage:
    """The ranges of a scan by direction.

    Attributes:
        range: (H, W) float32, metres; 0 where nothing came back.
        elevations: (H,) radians, of the rows from the top down.
        columns: (4096,) the column of an azimuth, by parts of the circle from -pi on.
    """

    range: NDArray[np.float32]
    elevations: Array
    columns: NDArray[np.int64]

    @classmethod
    def of(cls, stack: ImageStack) -> RangeImage:
        """The range image of a stack."""
        azimuths = (np.arange(_BINS) + 0.5) / _BINS * 2.0 * np.pi - np.pi
        geometry = stack.geometry
        if not geometry.organised:
            columns = np.clip((np.pi - azimuths) / geometry.column_step, 0, geometry.columns - 1).astype(np.int64)
            return cls(stack.range, geometry.elevations, columns)
        seen = stack.range > 0.0
        turned = np.exp(1j * stack.azimuth) * seen
        sums = turned.sum(axis=0)
        known = np.flatnonzero(np.abs(sums) > 0.0)
        order = known[np.argsort(np.angle(sums[known]))]
        places = np.angle(sums[order])
        nearest = np.searchsorted(places, azimuths)
        before, after = (nearest - 1) % len(order), nearest % len(order)
        apart = (np.abs(np.angle(np.exp(1j * (places[i] - azimuths)))) for i in (before, after))
        columns = order[np.where(next(apart) < next(apart), before, after)]
        return cls(stack.range, geometry.elevations, columns.astype(np.int64))

    def agreement(self, points: NDArray[np.float32], T_live_map: Array) -> float:
        """Part of a map's points (N, 3) in view that lie on a surface of this scan; 0 where none is in view."""
        if len(points) == 0:
            return 0.0
        on, off = _count(points.astype(np.float64), T_live_map, self.range, self.elevations, self.columns, *_TOLERANCE)
        return on / max(on + off, 1)


@kernel
def _count(
    points: Array,
    T: Array,
    range_: NDArray[np.float32],
    elevations: Array,
    columns: NDArray[np.int64],
    tolerance: float,
    relative: float,
) -> tuple[int, int]:
    """How many points lie within the ranges measured around their direction, and how many before or behind them."""
    height, width = range_.shape
    on, off = 0, 0
    for i in range(points.shape[0]):
        x = T[0, 0] * points[i, 0] + T[0, 1] * points[i, 1] + T[0, 2] * points[i, 2] + T[0, 3]
        y = T[1, 0] * points[i, 0] + T[1, 1] * points[i, 1] + T[1, 2] * points[i, 2] + T[1, 3]
        z = T[2, 0] * points[i, 0] + T[2, 1] * points[i, 1] + T[2, 2] * points[i, 2] + T[2, 3]
        ground = np.sqrt(x * x + y * y)
        distance, elevation = np.sqrt(ground * ground + z * z), np.arctan2(z, ground)
        if not (elevation <= elevations[0] and elevation >= elevations[height - 1]):
            continue
        part = (np.arctan2(y, x) + np.pi) / (2.0 * np.pi)
        column = columns[min(max(int(part * columns.shape[0]), 0), columns.shape[0] - 1)]
        row = 0
        while row < height - 1 and elevations[row] > elevation:
            row += 1
        if row > 0 and elevations[row - 1] - elevation < elevation - elevations[row]:
            row -= 1
        nearest, farthest = np.inf, 0.0
        for v in range(max(row - 1, 0), min(row + 2, height)):
            for u in range(column - 1, column + 2):
                measured = range_[v, u % width]
                if measured > 0.0:
                    nearest, farthest = min(nearest, measured), max(farthest, measured)
        if farthest == 0.0:
            continue
        margin = tolerance + relative * distance
        if nearest - margin <= distance <= farthest + margin:
            on += 1
        else:
            off += 1
    return on, off
