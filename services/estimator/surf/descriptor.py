"""The descriptor of 64 values: sums of Haar wavelets' responses over 4x4 parts of the square around a blob.

Section 4.2 of the paper: a square of side 20 s along the blob's orientation, wavelets of side 2 s at points s apart,
weighted by a Gaussian; of each part the sums of dx and of dy, and of their magnitudes; all brought to unit length.

A wavelet is the difference of means over four squares of side s, which neighbours share. The squares' centres turn with
the orientation; their sides stay along the axes, so that the integral image gives each from 4 corners.

Two things differ from the paper. A response is shared out to the parts around it linearly, as in SIFT, so that nothing
jumps where the square is a little off. And the Gaussian is of 8 s instead of 3.3 s: more of the square counts, which
blurred images need.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from common.compiled import kernel
from services.estimator.surf.features import VALUES
from services.estimator.surf.integral import Integral, box_mean, cell

GRID = 20
PARTS = 4
SIGMA = 8.0
REACH = 15.0
"""Largest distance of what a descriptor sees from the blob's centre, in scales."""

TINY = 1e-12
"""Length below which a descriptor is of nothing."""


def _shares() -> NDArray[np.float64]:
    """Weight (4, 20) with which a response at a place along the square's side counts for each part along it."""
    places, side = np.arange(GRID) - (GRID - 1) / 2, GRID / PARTS
    centres = side * (np.arange(PARTS) - (PARTS - 1) / 2)
    linear = np.maximum(1.0 - np.abs(places - centres[:, None]) / side, 0.0)
    return np.asarray(linear * np.exp(-(places**2) / (2.0 * SIGMA**2)), np.float64)


SHARES = _shares()


@kernel
def _means(sums: NDArray[np.int32], u: float, v: float, scale: float, angle: float, out: NDArray[np.float64]) -> None:
    """Means (21, 21) over squares of side ``scale`` on a grid of that spacing that is turned by the angle."""
    cos, sin = math.cos(angle) * scale, math.sin(angle) * scale
    for r in range(GRID + 1):
        down = r - GRID / 2
        for c in range(GRID + 1):
            right = c - GRID / 2
            out[r, c] = box_mean(sums, u + cos * right - sin * down, v + sin * right + cos * down, 0.5 * scale)


@kernel
def _upright_means(sums: NDArray[np.int32], u: float, v: float, scale: float, out: NDArray[np.float64]) -> None:
    """As :func:`_means` for an angle of 0, where the squares have common corners."""
    height, width = sums.shape
    columns, fractions = np.empty(GRID + 2, np.int64), np.empty(GRID + 2)
    for c in range(GRID + 2):
        columns[c], fractions[c] = cell(u + (c - 0.5 * (GRID + 1)) * scale, width)
    last, corners = np.zeros(GRID + 2), np.zeros(GRID + 2)
    for r in range(GRID + 2):
        row, f = cell(v + (r - 0.5 * (GRID + 1)) * scale, height)
        above, below = sums[row], sums[row + 1]
        for c in range(GRID + 2):
            k = columns[c]
            first = above[k] + fractions[c] * (np.int64(above[k + 1]) - above[k])
            second = below[k] + fractions[c] * (np.int64(below[k + 1]) - below[k])
            corners[c] = first + f * (second - first)
        if r > 0:
            for c in range(GRID + 1):
                out[r - 1, c] = ((corners[c + 1] - corners[c]) - (last[c + 1] - last[c])) / (scale * scale)
        last, corners = corners, last


@kernel
def _descriptor(means: NDArray[np.float64], values: NDArray[np.float64], out: NDArray[np.float32]) -> None:
    """The 64 values from the means, by way of the sums (4, 4, 4) over the parts."""
    values[:] = 0.0
    along = np.empty((4, PARTS))
    for r in range(GRID):
        along[:] = 0.0
        for c in range(GRID):
            falling, rising = means[r + 1, c + 1] - means[r, c], means[r, c + 1] - means[r + 1, c]
            dx, dy = falling + rising, falling - rising
            for q in range(PARTS):
                along[0, q] += SHARES[q, c] * dx
                along[1, q] += SHARES[q, c] * dy
                along[2, q] += SHARES[q, c] * abs(dx)
                along[3, q] += SHARES[q, c] * abs(dy)
        for p in range(PARTS):
            for q in range(PARTS):
                for k in range(4):
                    values[p, q, k] += SHARES[p, r] * along[k, q]
    length = max(math.sqrt((values * values).sum()), TINY)
    for i in range(VALUES):
        out[i] = values.ravel()[i] / length


@kernel
def _describe(
    sums: NDArray[np.int32],
    pad_x: int,
    pad_y: int,
    points: NDArray[np.float64],
    scales: NDArray[np.float64],
    angles: NDArray[np.float64],
) -> NDArray[np.float32]:
    out = np.empty((points.shape[0], VALUES), np.float32)
    means, values = np.empty((GRID + 1, GRID + 1)), np.empty((PARTS, PARTS, 4))
    for i in range(points.shape[0]):
        u, v = points[i, 0] + 0.5 + pad_x, points[i, 1] + 0.5 + pad_y
        if angles[i] == 0.0:
            _upright_means(sums, u, v, scales[i], means)
        else:
            _means(sums, u, v, scales[i], angles[i], means)
        _descriptor(means, values, out[i])
    return out


def describe(
    sums: Integral, points: NDArray[np.float64], scales: NDArray[np.float64], angles: NDArray[np.float64]
) -> NDArray[np.float32]:
    """Descriptors (N, 64) of blobs at points (N, 2), pixels, with their scales (N,) and angles (N,)."""
    return _describe(sums.sums, sums.pad_x, sums.pad_y, points, scales, angles)
