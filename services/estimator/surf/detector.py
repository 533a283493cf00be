"""The fast-Hessian detector: maxima of the Hessian's determinant over place and scale.

H. Bay, A. Ess, T. Tuytelaars and L. Van Gool, *Speeded-Up Robust Features (SURF)*, CVIU 110(3), 2008, section 3: second
derivatives of Gaussians become box filters of growing size on the integral image; maxima among 3x3x3 neighbours are
interpolated in place and scale.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from common.compiled import kernel
from services.estimator.surf.integral import Integral

SIGMA_PER_SIZE = 1.2 / 9.0
"""The filter of 9 pixels stands for a Gaussian of standard deviation 1.2 (section 3.2)."""

_BALANCE = np.float32(0.9 * 0.9)
"""Square of the weight that makes up for the boxes' approximation (equation 3)."""


class Octave(NamedTuple):
    """Filters that are compared with each other, and the grid on which they are evaluated.

    Attributes:
        sizes: side lengths of the filters, pixels.
        step: distance of the grid's points, pixels.
    """

    sizes: tuple[int, ...]
    step: int


class Blobs(NamedTuple):
    """N maxima, as found.

    Attributes:
        points: (N, 2) float64 ``[x, y]``, pixels.
        scales: (N,) float64, pixels.
        responses: (N,) float64, square grey levels.
        laplacians: (N,) int8, sign.
    """

    points: NDArray[np.float64]
    scales: NDArray[np.float64]
    responses: NDArray[np.float64]
    laplacians: NDArray[np.int8]


def octaves_of(height: int, width: int, octaves: int, layers: int) -> list[Octave]:
    """The octaves of which at least one filter with a smaller and a larger neighbour fits into the image.

    Sizes are 9, 15, 21, 27; 15, 27, 39, 51; and so on: steps double with each octave (figure 4).
    """
    all_of_them = [
        Octave(tuple(3 * (2 ** (octave + 1) * (layer + 1) + 1) for layer in range(layers)), 2**octave)
        for octave in range(octaves)
    ]
    return [octave for octave in all_of_them if octave.sizes[1] <= min(height, width)]


def reach_of(octaves: list[Octave]) -> int:
    """Pixels beyond the image's edge that the filters see."""
    return max(octave.sizes[-1] // 2 + octave.step + 1 for octave in octaves)


@kernel
def _responses(sums: NDArray[np.int32], pad_x: int, pad_y: int, size: int, step: int, out: NDArray[np.float32]) -> None:
    """Determinants of the Hessian on a grid that begins one step before the image's first pixel.

    The sums over the filters' rows are taken once per row of the grid: what is left are differences along it.
    """
    lobe, half = size // 3, size // 2
    width = sums.shape[1]
    along, across, crossed = np.empty(width, np.int32), np.empty(width, np.int32), np.empty(width, np.int32)
    area = np.float32(1.0 / (size * size))
    for r in range(out.shape[0]):
        y = pad_y + (r - 1) * step
        _strips(sums, y, lobe, half, along, across, crossed)
        for c in range(out.shape[1]):
            x = pad_x + (c - 1) * step
            xx = (along[x + half + 1] - along[x - half]) - 3 * (along[x + half + 1 - lobe] - along[x - half + lobe])
            yy = across[x + lobe] - across[x - lobe + 1]
            xy = (crossed[x + lobe + 1] - crossed[x + 1]) - (crossed[x] - crossed[x - lobe])
            d_xx, d_yy, d_xy = np.float32(xx) * area, np.float32(yy) * area, np.float32(xy) * area
            out[r, c] = d_xx * d_yy - _BALANCE * d_xy * d_xy


@kernel
def _strips(
    sums: NDArray[np.int32],
    y: int,
    lobe: int,
    half: int,
    along: NDArray[np.int32],
    across: NDArray[np.int32],
    crossed: NDArray[np.int32],
) -> None:
    """Sums over the rows of the filters around row y: of Dxx, of Dyy with its weights, of Dxy with its signs."""
    above, below = sums[y - lobe + 1], sums[y + lobe]
    top, bottom = sums[y - half], sums[y + half + 1]
    upper, lower = sums[y - half + lobe], sums[y + half + 1 - lobe]
    a, b, c, d = sums[y - lobe], sums[y], sums[y + 1], sums[y + lobe + 1]
    for x in range(sums.shape[1]):
        along[x] = below[x] - above[x]
        across[x] = (bottom[x] - top[x]) - 3 * (lower[x] - upper[x])
        crossed[x] = (d[x] - c[x]) - (b[x] - a[x])


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
def _maxima(stack: NDArray[np.float32], threshold: float) -> NDArray[np.int64]:
    """Indices (N, 3) of the maxima above the threshold, in the order of the array."""
    layers, rows, columns = stack.shape
    found = np.empty((max(layers * rows * columns // 8, 1), 3), np.int64)
    n = 0
    for k in range(1, layers - 1):
        for r in range(1, rows - 1):
            for c in range(1, columns - 1):
                value = stack[k, r, c]
                # The two neighbours along the row dismiss most.
                beside = value > stack[k, r, c - 1] and value >= stack[k, r, c + 1]
                if beside and value > threshold and _is_maximum(stack, k, r, c):
                    found[n, 0], found[n, 1], found[n, 2] = k, r, c
                    n += 1
    return found[:n].copy()


@kernel
def _offset(stack: NDArray[np.float32], k: int, r: int, c: int, out: NDArray[np.float64]) -> float:
    """Where the parabola through the 27 values has its maximum, ``[x, y, scale]`` in steps; returns its height.

    M. Brown and D. Lowe, *Invariant features from interest point groups*, BMVC 2002.
    """
    v = np.float64(stack[k, r, c])
    e, w = np.float64(stack[k, r, c + 1]), np.float64(stack[k, r, c - 1])
    s, n = np.float64(stack[k, r + 1, c]), np.float64(stack[k, r - 1, c])
    u, d = np.float64(stack[k + 1, r, c]), np.float64(stack[k - 1, r, c])
    gx, gy, gs = 0.5 * (e - w), 0.5 * (s - n), 0.5 * (u - d)
    xx, yy, ss = e - 2.0 * v + w, s - 2.0 * v + n, u - 2.0 * v + d
    plane, up, down = stack[k], stack[k + 1], stack[k - 1]
    xy = 0.25 * (np.float64(plane[r + 1, c + 1]) - plane[r + 1, c - 1] - plane[r - 1, c + 1] + plane[r - 1, c - 1])
    xs = 0.25 * (np.float64(up[r, c + 1]) - up[r, c - 1] - down[r, c + 1] + down[r, c - 1])
    ys = 0.25 * (np.float64(up[r + 1, c]) - up[r - 1, c] - down[r + 1, c] + down[r - 1, c])
    a, b, f = yy * ss - ys * ys, xs * ys - xy * ss, xy * ys - xs * yy
    determinant = xx * a + xy * b + xs * f
    g, h, i = xx * ss - xs * xs, xy * xs - xx * ys, xx * yy - xy * xy
    out[0] = -(a * gx + b * gy + f * gs) / determinant
    out[1] = -(b * gx + g * gy + h * gs) / determinant
    out[2] = -(f * gx + h * gy + i * gs) / determinant
    return float(v + 0.5 * (gx * out[0] + gy * out[1] + gs * out[2]))


@kernel
def _laplacian(sums: NDArray[np.int32], x: int, y: int, size: int) -> int:
    """Sign of the Laplacian by the filter of a size at a pixel, in coordinates of the sums."""
    lobe, half = size // 3, size // 2
    wide = _sum(sums, y - lobe + 1, y + lobe, x - half, x + half + 1)
    tall = _sum(sums, y - half, y + half + 1, x - lobe + 1, x + lobe)
    middle_x = _sum(sums, y - lobe + 1, y + lobe, x - half + lobe, x + half + 1 - lobe)
    middle_y = _sum(sums, y - half + lobe, y + half + 1 - lobe, x - lobe + 1, x + lobe)
    return 1 if wide + tall - 3 * (middle_x + middle_y) > 0 else -1


@kernel
def _sum(sums: NDArray[np.int32], top: int, bottom: int, left: int, right: int) -> int:
    below = np.int64(sums[bottom, right]) - np.int64(sums[bottom, left])
    return int(below - (np.int64(sums[top, right]) - np.int64(sums[top, left])))


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
    """Rows ``[x, y, scale, response, Laplacian]`` of the maxima whose parabola's lies within a step of them."""
    out = np.empty((maxima.shape[0], 5))
    shift = np.zeros(3)
    n = 0
    for i in range(maxima.shape[0]):
        k, r, c = maxima[i]
        response = _offset(stack, k, r, c, shift)
        # Not a number, where the parabola has no maximum, is not within a step either.
        if not (abs(shift[0]) < 1.0 and abs(shift[1]) < 1.0 and abs(shift[2]) < 1.0):
            continue
        out[n, 0], out[n, 1] = (c - 1 + shift[0]) * step, (r - 1 + shift[1]) * step
        out[n, 2] = SIGMA_PER_SIZE * (sizes[k] + shift[2] * (sizes[1] - sizes[0]))
        out[n, 3] = response
        out[n, 4] = _laplacian(sums, pad_x + (c - 1) * step, pad_y + (r - 1) * step, sizes[k])
        n += 1
    return out[:n].copy()


def detect(sums: Integral, height: int, width: int, octaves: list[Octave], threshold: float) -> Blobs:
    """All maxima of an image of that size, octave by octave."""
    rows = [np.zeros((0, 5))]
    for sizes, step in octaves:
        grid = (-(-height // step) + 2, -(-width // step) + 2)
        stack = np.empty((len(sizes), *grid), np.float32)
        for size, layer in zip(sizes, stack, strict=True):
            _responses(sums.sums, sums.pad_x, sums.pad_y, size, step, layer)
        maxima = _maxima(stack, threshold)
        rows.append(_refined(sums.sums, sums.pad_x, sums.pad_y, stack, maxima, np.array(sizes), step))
    found = np.concatenate(rows)
    return Blobs(found[:, :2], found[:, 2], found[:, 3], found[:, 4].astype(np.int8))
