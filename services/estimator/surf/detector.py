"""The fast-Hessian detector: maxima of the Hessian's determinant over place and scale.

H. Bay, A. Ess, T. Tuytelaars and L. Van Gool, *Speeded-Up Robust Features (SURF)*, CVIU 110(3), 2008, section 3: second
derivatives of Gaussians become box filters of growing size on the integral image; maxima among 3x3x3 neighbours are
interpolated in place and scale.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from common.compiled import kernel
from services.estimator.surf.integral import Integral
from services.estimator.surf.octaves import SIGMA_PER_SIZE, Octave

BALANCE = 0.9
"""Weight of Dxy, which makes up for the boxes' approximation (equation 3)."""

UNIT_SCALE = SIGMA_PER_SIZE * 9
"""Scale at which a response is the determinant, pixels."""

_WEIGHT = 0.75


class Blobs(NamedTuple):
    """N maxima, as found.

    Attributes:
        points: (N, 2) float64 ``[x, y]``, pixels.
        scales: (N,) float64, pixels.
        responses: (N,) float64, square grey levels: see :func:`weighted`.
        laplacians: (N,) int8, sign.
    """

    points: NDArray[np.float64]
    scales: NDArray[np.float64]
    responses: NDArray[np.float64]
    laplacians: NDArray[np.int8]


@kernel
def _edges(lobe: int) -> tuple[int, int, int]:
    """Offsets from a pixel to the edges of a box of that side around it; for an even one the first of two each."""
    return -(lobe // 2), (lobe + 1) // 2, 1 - lobe % 2


@kernel
def _strips(
    sums: NDArray[np.int32],
    y: int,
    lobe: int,
    along: NDArray[np.int32],
    across: NDArray[np.int32],
    crossed: NDArray[np.int32],
) -> None:
    """Sums over the rows of the filters around row y, from the first row of the sums: twice those of Dxx and Dyy.

    The latter with its weights, Dxy with its signs: what is left of each filter are differences along the row.
    """
    first, last, more = _edges(3 * lobe)
    inner_first, inner_last, _ = _edges(lobe)
    above, below = sums[y - lobe + 1], sums[y + lobe]
    top, bottom, upper, lower = sums[y + first], sums[y + last], sums[y + inner_first], sums[y + inner_last]
    top_2, bottom_2 = sums[y + first + more], sums[y + last + more]
    upper_2, lower_2 = sums[y + inner_first + more], sums[y + inner_last + more]
    a, b, c, d = sums[y - lobe], sums[y], sums[y + 1], sums[y + lobe + 1]
    above_2, below_2 = above[more:], below[more:]
    for x in range(above_2.shape[0]):
        along[x] = (below[x] - above[x]) + (below_2[x] - above_2[x])
        whole = (bottom[x] - top[x]) + (bottom_2[x] - top_2[x])
        across[x] = whole - 3 * ((lower[x] - upper[x]) + (lower_2[x] - upper_2[x]))
        crossed[x] = (d[x] - c[x]) - (b[x] - a[x])


@kernel
def _responses(sums: NDArray[np.int32], pad_x: int, pad_y: int, size: int, step: int, out: NDArray[np.float32]) -> None:
    """Determinants of the Hessian on a grid that begins one step before the image's first pixel.

    Every pixel of the grid's rows is evaluated and every ``step``-th is kept: adjacent ones are worked on at once.
    """
    lobe = size // 3
    first, last, _ = _edges(size)
    inner_first, inner_last, _ = _edges(lobe)
    width = sums.shape[1]
    along, across, crossed = np.empty(width, np.int32), np.empty(width, np.int32), np.empty(width, np.int32)
    row = np.empty((out.shape[1] - 1) * step + 1, np.float32)
    begin = pad_x - step
    # Views spare the loop the tests of a negative index.
    left, right = along[begin + first :], along[begin + last :]
    inner_left, inner_right = along[begin + inner_first :], along[begin + inner_last :]
    above, below = across[begin - lobe + 1 :], across[begin + lobe :]
    a, b, c, d = crossed[begin - lobe :], crossed[begin:], crossed[begin + 1 :], crossed[begin + lobe + 1 :]
    weight = np.float32(1.0 / (2 * size * size))
    weight_xy = np.float32(BALANCE / (size * size))
    for r in range(out.shape[0]):
        _strips(sums, pad_y + (r - 1) * step, lobe, along, across, crossed)
        for x in range(row.shape[0]):
            xx = np.float32(np.int32((right[x] - left[x]) - 3 * (inner_right[x] - inner_left[x]))) * weight
            yy = np.float32(np.int32(below[x] - above[x])) * weight
            xy = np.float32(np.int32((d[x] - c[x]) - (b[x] - a[x]))) * weight_xy
            row[x] = xx * yy - xy * xy
        out[r] = row[::step]


@kernel
def _is_maximum(stack: NDArray[np.float32], k: int, r: int, c: int) -> bool:
    """Whether no neighbour of the 26 exceeds an entry; of equals the first stays."""
    value = stack[k, r, c]
    for dk in range(-1, 2):
        for dr in range(-1, 2):
            for dc in range(-1, 2):
                other = stack[k + dk, r + dr, c + dc]
                before = dk < 0 or (dk == 0 and (dr < 0 or (dr == 0 and dc < 0)))
                if other > value or (before and other == value):
                    return False
    return True


@kernel
def _maxima(stack: NDArray[np.float32], thresholds: NDArray[np.float32]) -> NDArray[np.int64]:
    """Indices (N, 3) of the maxima above their layer's threshold, in the order of the array."""
    layers, rows, columns = stack.shape
    # No two of 2x2x2 neighbours are both maxima.
    found = np.empty(((layers // 2 + 1) * (rows // 2 + 1) * (columns // 2 + 1), 3), np.int64)
    n = 0
    for k in range(1, layers - 1):
        for r in range(1, rows - 1):
            row, above, below = stack[k, r], stack[k, r - 1], stack[k, r + 1]
            for c in range(1, columns - 1):
                value = row[c]
                if value <= thresholds[k] or value <= row[c - 1] or value < row[c + 1]:
                    continue
                if value > above[c] and value >= below[c] and _is_maximum(stack, k, r, c):
                    found[n, 0], found[n, 1], found[n, 2] = k, r, c
                    n += 1
    return found[:n].copy()


@kernel
def _offset(
    stack: NDArray[np.float32], sizes: NDArray[np.int64], k: int, r: int, c: int, out: NDArray[np.float64]
) -> float:
    """Where the parabola through the neighbours has its maximum: x and y in steps, the logarithm of the scale.

    M. Brown and D. Lowe, *Invariant features from interest point groups*, BMVC 2002; the layers lie unevenly, by the
    logarithms of their sizes. Returns the parabola's height there.
    """
    lower, upper = math.log(sizes[k] / sizes[k - 1]), math.log(sizes[k + 1] / sizes[k])
    ahead, back = lower / (upper * (lower + upper)), upper / (lower * (lower + upper))
    slopes = np.empty((3, 2))
    for i in range(3):
        plane = stack[k - 1 + i]
        slopes[i, 0] = 0.5 * (np.float64(plane[r, c + 1]) - np.float64(plane[r, c - 1]))
        slopes[i, 1] = 0.5 * (np.float64(plane[r + 1, c]) - np.float64(plane[r - 1, c]))
    here, plane = np.float64(stack[k, r, c]), stack[k]
    up, down = np.float64(stack[k + 1, r, c]) - here, here - np.float64(stack[k - 1, r, c])
    gx, gy, gs = slopes[1, 0], slopes[1, 1], ahead * up + back * down
    xx = np.float64(plane[r, c + 1]) + np.float64(plane[r, c - 1]) - 2.0 * here
    yy = np.float64(plane[r + 1, c]) + np.float64(plane[r - 1, c]) - 2.0 * here
    ss = 2.0 * (up / upper - down / lower) / (lower + upper)
    rising = np.float64(plane[r + 1, c + 1]) + np.float64(plane[r - 1, c - 1])
    xy = 0.25 * (rising - np.float64(plane[r + 1, c - 1]) - np.float64(plane[r - 1, c + 1]))
    xs = ahead * (slopes[2, 0] - gx) + back * (gx - slopes[0, 0])
    ys = ahead * (slopes[2, 1] - gy) + back * (gy - slopes[0, 1])
    # The inverse of a symmetric 3x3 matrix, by cofactors.
    a, b, c_ = yy * ss - ys * ys, xs * ys - xy * ss, xy * ys - xs * yy
    d, e, f = xx * ss - xs * xs, xy * xs - xx * ys, xx * yy - xy * xy
    determinant = xx * a + xy * b + xs * c_
    out[0] = -(a * gx + b * gy + c_ * gs) / determinant
    out[1] = -(b * gx + d * gy + e * gs) / determinant
    out[2] = -(c_ * gx + e * gy + f * gs) / determinant
    return float(here + 0.5 * (gx * out[0] + gy * out[1] + gs * out[2]))


@kernel
def _sum(sums: NDArray[np.int32], top: int, bottom: int, left: int, right: int) -> int:
    below = np.int64(sums[bottom, right]) - np.int64(sums[bottom, left])
    return int(below - (np.int64(sums[top, right]) - np.int64(sums[top, left])))


@kernel
def _laplacian(sums: NDArray[np.int32], x: int, y: int, size: int) -> int:
    """Sign of the Laplacian by the filter of a size at a pixel, in coordinates of the sums."""
    lobe = size // 3
    first, last, more = _edges(size)
    inner_first, inner_last, _ = _edges(lobe)
    total = 0
    for shift in (0, more):
        total += _sum(sums, y - lobe + 1, y + lobe, x + first + shift, x + last + shift)
        total -= 3 * _sum(sums, y - lobe + 1, y + lobe, x + inner_first + shift, x + inner_last + shift)
        total += _sum(sums, y + first + shift, y + last + shift, x - lobe + 1, x + lobe)
        total -= 3 * _sum(sums, y + inner_first + shift, y + inner_last + shift, x - lobe + 1, x + lobe)
    return 1 if total > 0 else -1


@kernel
def _refined(
    sums: NDArray[np.int32],
    pad_x: int,
    pad_y: int,
    stack: NDArray[np.float32],
    maxima: NDArray[np.int64],
    sizes: NDArray[np.int64],
    step: int,
) -> NDArray[np.float64]:
    """Rows ``[x, y, scale, determinant, Laplacian]`` of the maxima whose parabola's lies among their neighbours."""
    out = np.empty((maxima.shape[0], 5))
    shift = np.zeros(3)
    n = 0
    for i in range(maxima.shape[0]):
        k, r, c = maxima[i]
        height = _offset(stack, sizes, k, r, c, shift)
        size = sizes[k] * math.exp(shift[2])
        # Not a number, where the parabola has no maximum, does not lie among them either.
        if not (abs(shift[0]) < 1.0 and abs(shift[1]) < 1.0 and sizes[k - 1] < size < sizes[k + 1]):
            continue
        out[n, 0], out[n, 1] = (c - 1 + shift[0]) * step, (r - 1 + shift[1]) * step
        out[n, 2], out[n, 3] = SIGMA_PER_SIZE * size, height
        out[n, 4] = _laplacian(sums, pad_x + (c - 1) * step, pad_y + (r - 1) * step, sizes[k])
        n += 1
    return out[:n].copy()


def weighted(scales: NDArray[np.float64]) -> NDArray[np.float64]:
    """Responses (N,) of blobs of these scales whose determinant is 1.

    By the determinant alone nearly all places would go to the finest blobs, which are the most, and the first to vanish
    in a blurred or reduced image. Measured in white noise a determinant weighs by the square of its scale, and too many
    places would go to the coarsest blobs, whose places are the least certain. A power between the two serves both.
    """
    return np.asarray((scales / UNIT_SCALE) ** _WEIGHT, np.float64)


def thresholds(sizes: tuple[int, ...], threshold: float) -> NDArray[np.float32]:
    """Determinants (layers,) whose responses are the threshold."""
    return (threshold / weighted(SIGMA_PER_SIZE * np.array(sizes))).astype(np.float32)


def detect(sums: Integral, shape: tuple[int, int], octaves: list[Octave], threshold: float) -> Blobs:
    """All maxima of an image of that shape, octave by octave."""
    height, width = shape
    rows = [np.zeros((0, 5))]
    for sizes, step in octaves:
        stack = np.empty((len(sizes), -(-height // step) + 2, -(-width // step) + 2), np.float32)
        for size, layer in zip(sizes, stack, strict=True):
            _responses(sums.sums, sums.pad_x, sums.pad_y, size, step, layer)
        maxima = _maxima(stack, thresholds(sizes, threshold))
        rows.append(_refined(sums.sums, sums.pad_x, sums.pad_y, stack, maxima, np.array(sizes), step))
    found = np.concatenate(rows)
    return Blobs(found[:, :2], found[:, 2], found[:, 3] * weighted(found[:, 2]), found[:, 4].astype(np.int8))
