"""The orientation of a blob: where most of the brightness around it rises to.

Section 4.1 of the paper: Haar wavelets of side 4 s at points s apart within a radius of 6 s, weighted by a Gaussian of
2 s; the longest sum of the responses within a sector of 60 degrees, which slides by 5 degrees.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from common.compiled import kernel
from services.estimator.surf.integral import Integral, cell

RADIUS = 6
BINS = 72
SECTOR = 12
"""Bins of 5 degrees of a sector."""

REACH = RADIUS + 1
"""Half the side of the grid of the wavelets' corners, in scales."""


def _samples() -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Points (109, 2) ``[row, column]`` on the grid of corners within the radius, and their weights (109,)."""
    steps = np.arange(-RADIUS, RADIUS + 1)
    rows, columns = (a.ravel() for a in np.meshgrid(steps, steps, indexing="ij"))
    near = rows**2 + columns**2 < RADIUS**2
    squares = (rows**2 + columns**2)[near]
    return np.column_stack([rows, columns])[near] + REACH, np.exp(-squares / (2.0 * 2.0**2))


SAMPLES, WEIGHTS = _samples()


@kernel
def _corners(sums: NDArray[np.int32], u: float, v: float, scale: float, out: NDArray[np.float64]) -> None:
    """The integral image at the corners of a grid of spacing ``scale``, relative to its value in their middle."""
    side = 2 * REACH + 1
    height, width = sums.shape
    columns, fractions = np.empty(side, np.int64), np.empty(side)
    for i in range(side):
        columns[i], fractions[i] = cell(u + (i - REACH) * scale, width)
    for j in range(side):
        row, f = cell(v + (j - REACH) * scale, height)
        for i in range(side):
            c = columns[i]
            first = sums[row, c] + fractions[i] * (np.int64(sums[row, c + 1]) - sums[row, c])
            second = sums[row + 1, c] + fractions[i] * (np.int64(sums[row + 1, c + 1]) - sums[row + 1, c])
            out[j, i] = first + f * (second - first)


@kernel
def _sectors(corners: NDArray[np.float64], bins: NDArray[np.float64]) -> None:
    """Sum the weighted responses into bins (72, 2) by their direction."""
    bins[:] = 0.0
    for i in range(SAMPLES.shape[0]):
        r, c = SAMPLES[i]
        right = corners[r + 2, c + 2] - corners[r - 2, c + 2]
        left = corners[r + 2, c - 2] - corners[r - 2, c - 2]
        below = corners[r + 2, c + 2] - corners[r + 2, c - 2]
        above = corners[r - 2, c + 2] - corners[r - 2, c - 2]
        dx = right + left - 2.0 * (corners[r + 2, c] - corners[r - 2, c])
        dy = below + above - 2.0 * (corners[r, c + 2] - corners[r, c - 2])
        direction = math.floor((math.atan2(dy, dx) + math.pi) * (BINS / (2.0 * math.pi))) % BINS
        bins[direction, 0] += WEIGHTS[i] * dx
        bins[direction, 1] += WEIGHTS[i] * dy


@kernel
def _angles(
    sums: NDArray[np.int32], pad_x: int, pad_y: int, points: NDArray[np.float64], scales: NDArray[np.float64]
) -> NDArray[np.float64]:
    out = np.empty(points.shape[0])
    corners, bins = np.empty((2 * REACH + 1, 2 * REACH + 1)), np.empty((BINS, 2))
    for i in range(points.shape[0]):
        _corners(sums, points[i, 0] + 0.5 + pad_x, points[i, 1] + 0.5 + pad_y, scales[i], corners)
        _sectors(corners, bins)
        longest = -1.0
        for start in range(BINS):
            x = y = 0.0
            for k in range(SECTOR):
                x += bins[(start + k) % BINS, 0]
                y += bins[(start + k) % BINS, 1]
            if x * x + y * y > longest:
                longest = x * x + y * y
                out[i] = math.atan2(y, x)
    return out


def orient(sums: Integral, points: NDArray[np.float64], scales: NDArray[np.float64]) -> NDArray[np.float64]:
    """Angles (N,), radians from the x axis towards the y axis, of blobs at points (N, 2), pixels."""
    return _angles(sums.sums, sums.pad_x, sums.pad_y, points, scales)
