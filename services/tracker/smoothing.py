"""A smooth plane curve through the noisy points of a driven path."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.linalg import solveh_banded

Array = NDArray[np.float64]

_STRAIGHTENING = 1e-9
"""Weight of the second difference: picks the straight line where too few points determine a parabola."""
_MOST_ROUNDS = 15
"""Rounds of giving weight to the points that are missed; three to six are usual."""


@dataclass(frozen=True, slots=True)
class SmoothingSettings:
    """How points become a curve: metres.

    Attributes:
        wavelength: shorter wiggles are taken for noise.
        tolerance: the curve passes every point closer than this.
        spacing: distance between the samples of the curve.
    """

    wavelength: float = 2.5
    tolerance: float = 0.02
    spacing: float = 0.1


@dataclass(frozen=True, slots=True)
class Curve:
    """Samples of a plane curve, in order, by arclength.

    Arclength ``s`` (M,), ``xy`` (M, 2), ``heading`` (M,) of the tangent, unwrapped, ``curvature`` (M,), positive to the
    left, and the arclength ``point_s`` (N,) of each point that the curve was made from.
    """

    s: Array
    xy: Array
    heading: Array
    curvature: Array
    point_s: Array


def smooth(points: Array, settings: SmoothingSettings) -> Curve:
    """The smooth curve near points (N, 2), N >= 2, of a path of some length, given in the order of driving.

    It minimises ``int |p - q|^2 ds + (L / 2 pi)^6 int |p'''|^2 ds`` (Whittaker's graduation; Eilers, *A perfect
    smoother*, 2003) on a uniform grid. Third differences leave arcs of constant curvature almost untouched, where
    the usual second ones would pull them inwards. Points that the curve misses by more than the tolerance gain weight
    until it does not: a kink, such as an inexact edge between two experiences, stays a local matter.
    """
    chord = np.linalg.norm(np.diff(points, axis=0), axis=1)
    u = np.concatenate([[0.0], np.cumsum(chord)])
    count = max(int(np.ceil(u[-1] / settings.spacing)) + 1, 6)
    grid = np.linspace(0.0, u[-1], count)
    sampling = _linear_interpolation(u, grid)
    # Each point stands for its share of the path, so that a cluster of vertices does not outweigh a long gap.
    weight = np.maximum(np.gradient(u), 1e-3)
    for _ in range(_MOST_ROUNDS):
        xy = _graduate(points, weight, grid, sampling, settings.wavelength)
        missed = np.linalg.norm(sampling @ xy - points, axis=1) > settings.tolerance
        if not missed.any():
            break
        weight = np.where(missed, 3.0 * weight, weight)
    return _measure(grid, xy, u)


def _linear_interpolation(u: Array, grid: Array) -> sparse.csr_array:
    """The matrix (N, M) that reads a grid function (M,) at the parameters ``u`` (N,)."""
    step = grid[1] - grid[0]
    left = np.clip((u / step).astype(np.int64), 0, len(grid) - 2)
    fraction = np.clip(u / step - left, 0.0, 1.0)
    rows = np.arange(len(u))
    values = np.concatenate([1.0 - fraction, fraction])
    where = (np.concatenate([rows, rows]), np.concatenate([left, left + 1]))
    return sparse.csr_array((values, where), shape=(len(u), len(grid)))


def _graduate(points: Array, weight: Array, grid: Array, sampling: sparse.csr_array, wavelength: float) -> Array:
    """The minimiser (M, 2) of the functional of :func:`smooth`, by one banded Cholesky factorisation."""
    step = grid[1] - grid[0]
    roughness = (wavelength / (2.0 * np.pi)) ** 6 / step**5
    third, second = _difference(len(grid), 3), _difference(len(grid), 2)
    normal = sampling.T @ sparse.diags_array(weight) @ sampling
    normal = normal + roughness * (third.T @ third) + _STRAIGHTENING * (second.T @ second) / step**3
    banded = np.zeros((4, len(grid)))
    for offset in range(4):
        banded[offset, : len(grid) - offset] = normal.diagonal(-offset)
    return np.asarray(solveh_banded(banded, sampling.T @ (weight[:, None] * points), lower=True))


def _difference(count: int, order: int) -> sparse.csr_array:
    """The forward difference operator (count - order, count)."""
    coefficients = {2: (1.0, -2.0, 1.0), 3: (-1.0, 3.0, -3.0, 1.0)}[order]
    diagonals = [[c] * (count - order) for c in coefficients]
    shape = (count - order, count)
    return sparse.csr_array(sparse.diags_array(diagonals, offsets=list(range(order + 1)), shape=shape))


def _measure(grid: Array, xy: Array, u: Array) -> Curve:
    """Arclength, heading and curvature of grid samples, by central differences."""
    step = grid[1] - grid[0]
    first = np.gradient(xy, step, axis=0, edge_order=2)
    second = np.empty_like(xy)
    second[1:-1] = np.diff(xy, 2, axis=0) / step**2
    second[0], second[-1] = second[1], second[-2]
    speed = np.maximum(np.linalg.norm(first, axis=1), 1e-9)
    curvature = (first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]) / speed**3
    s = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(xy, axis=0), axis=1))])
    heading = np.unwrap(np.arctan2(first[:, 1], first[:, 0]))
    return Curve(s, xy, heading, curvature, np.interp(u, grid, s))
