"""The descriptor of 64 values: sums of Haar wavelets' responses over 4x4 parts of the square around a blob.

Section 4.2 of the paper: a square of side 20 s along the blob's orientation, wavelets of side 2 s at points s apart,
weighted by a Gaussian of 3.3 s; of each part the sums of dx and of dy, and of their magnitudes; all brought to unit
length.

A wavelet is the difference of means over four squares of side s, which neighbours share. The squares' centres turn with
the orientation; their sides stay along the axes, so that the integral image gives each from 4 corners.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from common.compiled import kernel
from services.estimator.surf.features import VALUES
from services.estimator.surf.integral import Integral, box_mean

GRID = 20
PARTS = 4
REACH = 15.0
"""Largest distance of what a descriptor sees from the blob's centre, in scales."""


def _weights() -> NDArray[np.float64]:
    """Gaussian weights (20, 20) of the wavelets."""
    squares = (np.arange(GRID) - (GRID - 1) / 2) ** 2
    return np.exp(-(squares[:, None] + squares) / (2.0 * 3.3**2))


WEIGHTS = _weights()


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
def _descriptor(means: NDArray[np.float64], out: NDArray[np.float32]) -> None:
    """The 64 values from the means."""
    values = np.zeros(VALUES)
    side = GRID // PARTS
    for r in range(GRID):
        for c in range(GRID):
            down, up = means[r + 1, c + 1] - means[r, c], means[r, c + 1] - means[r + 1, c]
            dx, dy = WEIGHTS[r, c] * (down + up), WEIGHTS[r, c] * (down - up)
            part = 4 * ((r // side) * PARTS + c // side)
            values[part] += dx
            values[part + 1] += dy
            values[part + 2] += abs(dx)
            values[part + 3] += abs(dy)
    length = math.sqrt((values * values).sum())
    out[:] = values / max(length, 1e-12)


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
    means = np.empty((GRID + 1, GRID + 1))
    for i in range(points.shape[0]):
        _means(sums, points[i, 0] + 0.5 + pad_x, points[i, 1] + 0.5 + pad_y, scales[i], angles[i], means)
        _descriptor(means, out[i])
    return out


def describe(
    sums: Integral, points: NDArray[np.float64], scales: NDArray[np.float64], angles: NDArray[np.float64]
) -> NDArray[np.float32]:
    """Descriptors (N, 64) of blobs at points (N, 2), pixels, with their scales (N,) and angles (N,)."""
    return _describe(sums.sums, sums.pad_x, sums.pad_y, points, scales, angles)
