"""The orientation of a blob: where the brightness around it rises to.

Section 4.1 of the paper: Haar wavelets of side 4 s at points s apart around the blob, weighted by a Gaussian; the
longest sum of the responses within a sector that slides over all directions. The paper's sector is sharp and of 60
degrees, so that the sum jumps as responses enter and leave it. Here a response counts by the cosine of half its angle
to the sector's middle, the circle has a radius of 7 s instead of 6 s and the Gaussian 3 s instead of 2 s: half as many
orientations are lost when an image turns.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from common.compiled import kernel
from services.estimator.surf.integral import Integral, cell

RADIUS = 7
SIGMA = 3.0
BINS = 72

HALF = 2
"""Half the side of a wavelet, in scales."""

REACH = RADIUS - 1 + HALF
"""Half the side of the grid of the wavelets' corners, in scales."""


def _samples() -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Points (145, 2) ``[row, column]`` on the grid of corners within the radius, and their weights (145,)."""
    steps = np.arange(-RADIUS, RADIUS + 1)
    rows, columns = (a.ravel() for a in np.meshgrid(steps, steps, indexing="ij"))
    near = rows**2 + columns**2 < RADIUS**2
    squares = (rows**2 + columns**2)[near]
    return np.column_stack([rows, columns])[near] + REACH, np.exp(-squares / (2.0 * SIGMA**2))


SAMPLES, WEIGHTS = _samples()

SECTORS = np.abs(np.cos(0.5 * np.subtract.outer(np.arange(BINS), np.arange(BINS)) * (2.0 * np.pi / BINS)))
"""Weight (72, 72) of a bin in a sector: symmetric."""


@kernel
def _corners(sums: NDArray[np.int32], u: float, v: float, scale: float, out: NDArray[np.float64]) -> None:
    """The integral image at the corners of a grid of spacing ``scale`` around ``(u, v)``."""
    side = 2 * REACH + 1
    height, width = sums.shape
    columns, fractions = np.empty(side, np.int64), np.empty(side)
    for i in range(side):
        columns[i], fractions[i] = cell(u + (i - REACH) * scale, width)
    for j in range(side):
        row, f = cell(v + (j - REACH) * scale, height)
        above, below = sums[row], sums[row + 1]
        for i in range(side):
            c = columns[i]
            first = above[c] + fractions[i] * (np.int64(above[c + 1]) - above[c])
            second = below[c] + fractions[i] * (np.int64(below[c + 1]) - below[c])
            out[j, i] = first + f * (second - first)


@kernel
def _bins(corners: NDArray[np.float64], bins: NDArray[np.float64]) -> None:
    """Sum the weighted responses into bins (2, 72) by their direction."""
    bins[:] = 0.0
    for i in range(SAMPLES.shape[0]):
        r, c = SAMPLES[i]
        top, middle, bottom = corners[r - HALF], corners[r], corners[r + HALF]
        first, last = c - HALF, c + HALF
        right, left = bottom[last] - top[last], bottom[first] - top[first]
        below, above = bottom[last] - bottom[first], top[last] - top[first]
        dx = right + left - 2.0 * (bottom[c] - top[c])
        dy = below + above - 2.0 * (middle[last] - middle[first])
        # The axes lie in the middle of bins: pixels favour them, and rounding must not tell.
        direction = int((math.atan2(dy, dx) + math.pi) * (BINS / (2.0 * math.pi)) + 0.5) % BINS
        bins[0, direction] += WEIGHTS[i] * dx
        bins[1, direction] += WEIGHTS[i] * dy


@kernel
def _longest(bins: NDArray[np.float64], total: NDArray[np.float64]) -> float:
    """Direction of the longest sum over a sector."""
    total[:] = 0.0
    for k in range(BINS):
        weights, x, y = SECTORS[k], bins[0, k], bins[1, k]
        for sector in range(BINS):
            total[0, sector] += weights[sector] * x
            total[1, sector] += weights[sector] * y
    best = np.argmax(total[0] ** 2 + total[1] ** 2)
    return math.atan2(total[1, best], total[0, best])


@kernel
def _angles(
    sums: NDArray[np.int32], pad_x: int, pad_y: int, points: NDArray[np.float64], scales: NDArray[np.float64]
) -> NDArray[np.float64]:
    out = np.empty(points.shape[0])
    corners, bins, total = np.empty((2 * REACH + 1, 2 * REACH + 1)), np.empty((2, BINS)), np.empty((2, BINS))
    for i in range(points.shape[0]):
        _corners(sums, points[i, 0] + 0.5 + pad_x, points[i, 1] + 0.5 + pad_y, scales[i], corners)
        _bins(corners, bins)
        out[i] = _longest(bins, total)
    return out


def orient(sums: Integral, points: NDArray[np.float64], scales: NDArray[np.float64]) -> NDArray[np.float64]:
    """Angles (N,), radians from the x axis towards the y axis, of blobs at points (N, 2), pixels."""
    return _angles(sums.sums, sums.pad_x, sums.pad_y, points, scales)
