"""Pairs of features of two images whose descriptors are each other's nearest.

Section 5 of the paper: only blobs of the same sign of the Laplacian are compared; the nearest must be clearly nearer
than the second nearest.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from common.compiled import kernel
from services.estimator.surf.features import SurfError, SurfFeatures
from services.estimator.surf.settings import SurfSettings

_NONE = -2.0
"""In place of a product of two descriptors: smaller than any."""


class SurfMatches(NamedTuple):
    """M pairs, in the order of the first set.

    Attributes:
        pairs: (M, 2) int64, indices into the first and the second set.
        distances: (M,) float32 between their descriptors.
    """

    pairs: NDArray[np.int64]
    distances: NDArray[np.float32]


@dataclass(frozen=True, slots=True)
class Window:
    """Where the features of the first set are expected in the second image.

    Attributes:
        predicted: (Na, 2) ``[x, y]``, pixels; not finite: nowhere.
        reach: largest distance from there along x and along y, pixels: ``(dx, dy)``, or (Na, 2) for each.
        width: of a panorama, pixels, whose left and right edges are neighbours; None: of an image with edges.
    """

    predicted: NDArray[Any]
    reach: tuple[float, float] | NDArray[Any]
    width: float | None = None


@kernel
def _nearest(
    products: NDArray[np.float32],
    signs_a: NDArray[np.int8],
    signs_b: NDArray[np.int8],
    allowed: NDArray[np.bool_],
) -> tuple[NDArray[np.int64], NDArray[np.float32], NDArray[np.float32], NDArray[np.int64]]:
    """Of each row the column of the largest product (-1: none), it, and the second; of each column the row likewise."""
    rows, columns = products.shape
    best, owner = np.full(rows, -1, np.int64), np.full(columns, -1, np.int64)
    first, second = np.full(rows, _NONE, np.float32), np.full(rows, _NONE, np.float32)
    highest = np.full(columns, _NONE, np.float32)
    restricted = allowed.shape[0] > 0
    for i in range(rows):
        for j in range(columns):
            if signs_a[i] != signs_b[j] or (restricted and not allowed[i, j]):
                continue
            product = products[i, j]
            if product > first[i]:
                first[i], second[i], best[i] = product, first[i], j
            elif product > second[i]:
                second[i] = product
            if product > highest[j]:
                highest[j], owner[j] = product, i
    return best, first, second, owner


@kernel
def _within(
    points: NDArray[np.float64],
    at: NDArray[np.float64],
    reach: NDArray[np.float64],
    width: float,
    out: NDArray[np.int64],
) -> int:
    """Write the indices of the points, in the order of their y, that lie in a window; returns their number."""
    n = 0
    if not (math.isfinite(at[0]) and math.isfinite(at[1])):
        return n
    for j in range(np.searchsorted(points[:, 1], at[1] - reach[1]), points.shape[0]):
        if points[j, 1] > at[1] + reach[1]:
            break
        apart = points[j, 0] - at[0]
        if width > 0.0:
            apart -= width * np.round(apart / width)
        if abs(apart) <= reach[0]:
            out[n] = j
            n += 1
    return n


@kernel
def _nearest_in_windows(
    a: NDArray[np.float32],
    b: NDArray[np.float32],
    signs_a: NDArray[np.int8],
    signs_b: NDArray[np.int8],
    points: NDArray[np.float64],
    predicted: NDArray[np.float64],
    reach: NDArray[np.float64],
    width: float,
) -> tuple[NDArray[np.int64], NDArray[np.float32], NDArray[np.float32], NDArray[np.int64]]:
    """As :func:`_nearest`, among the second set's points, in the order of their y, that lie in the windows."""
    rows, columns = a.shape[0], b.shape[0]
    best, owner = np.full(rows, -1, np.int64), np.full(columns, -1, np.int64)
    first, second = np.full(rows, _NONE, np.float32), np.full(rows, _NONE, np.float32)
    highest, near = np.full(columns, _NONE, np.float32), np.empty(columns, np.int64)
    for i in range(rows):
        for j in near[: _within(points, predicted[i], reach[i], width, near)]:
            if signs_a[i] != signs_b[j]:
                continue
            product = np.float32(0.0)
            for k in range(a.shape[1]):
                product += a[i, k] * b[j, k]
            if product > first[i]:
                first[i], second[i], best[i] = product, first[i], j
            elif product > second[i]:
                second[i] = product
            if product > highest[j]:
                highest[j], owner[j] = product, i
    return best, first, second, owner


def match(
    a: SurfFeatures,
    b: SurfFeatures,
    settings: SurfSettings | None = None,
    *,
    ratio: float | None = None,
    mutual: bool = True,
    candidates: NDArray[np.bool_] | Window | None = None,
) -> SurfMatches:
    """Match two sets of features.

    ``ratio`` replaces the settings'; with ``mutual`` each must be the other's nearest. ``candidates`` restricts the
    search: a mask (Na, Nb), or windows around predicted points. A feature with a single candidate passes the ratio.

    Raises:
        SurfError: the candidates do not have the sets' shapes.
    """
    used = settings or SurfSettings()
    if len(a) == 0 or len(b) == 0:
        return SurfMatches(np.zeros((0, 2), np.int64), np.zeros(0, np.float32))
    if isinstance(candidates, Window):
        best, first, second, owner = _by_window(a, b, candidates)
    else:
        allowed = np.zeros((0, 0), np.bool_) if candidates is None else np.ascontiguousarray(candidates, np.bool_)
        if candidates is not None and allowed.shape != (len(a), len(b)):
            raise SurfError(f"the candidates' mask must be {(len(a), len(b))}, not {allowed.shape}")
        products = a.descriptors @ b.descriptors.T
        best, first, second, owner = _nearest(products, a.laplacians, b.laplacians, allowed)
    nearest, next_nearest = (np.sqrt(np.maximum(2.0 - 2.0 * product, 0.0)) for product in (first, second))
    limit = used.ratio if ratio is None else ratio
    good = (best >= 0) & (nearest <= used.max_distance)
    good &= (nearest <= limit * next_nearest) | (second == _NONE)
    if mutual:
        good &= owner[best] == np.arange(len(a))
    rows = np.flatnonzero(good)
    return SurfMatches(np.column_stack([rows, best[rows]]), nearest[rows].astype(np.float32))


def _by_window(
    a: SurfFeatures, b: SurfFeatures, window: Window
) -> tuple[NDArray[np.int64], NDArray[np.float32], NDArray[np.float32], NDArray[np.int64]]:
    predicted = np.ascontiguousarray(window.predicted, np.float64)
    if predicted.shape != (len(a), 2):
        raise SurfError(f"the predicted points must be {(len(a), 2)}, not {predicted.shape}")
    reach = np.ascontiguousarray(np.broadcast_to(np.asarray(window.reach, np.float64), predicted.shape))
    order = np.argsort(b.points[:, 1], kind="stable")
    best, first, second, owner = _nearest_in_windows(
        a.descriptors, b.descriptors[order], a.laplacians, b.laplacians[order],
        b.points[order].astype(np.float64), predicted, reach, window.width or 0.0,
    )  # fmt: skip
    owners = np.empty_like(owner)
    owners[order] = owner
    return np.where(best >= 0, order[best], -1), first, second, owners
