"""The fast-Hessian detector on whole arrays: see :mod:`services.estimator.surf.detector`."""

from __future__ import annotations

import numpy as np

from services.estimator.surf.arrays.device import Array, Device
from services.estimator.surf.arrays.sums import Sums, take
from services.estimator.surf.detector import BALANCE, Blobs, thresholds, weighted
from services.estimator.surf.octaves import SIGMA_PER_SIZE, Octave


class _Grid:
    """The integral image as seen from the points of a grid, which begins one step before the image's first pixel."""

    def __init__(self, sums: Sums, shape: tuple[int, int], step: int) -> None:
        self.sums, self.step = sums, step
        self.rows, self.columns = (-(-side // step) + 2 for side in shape)

    def box(self, top: int, bottom: int, left: int, right: int) -> Array:
        """Sums (rows, columns) over the box between offsets from each point."""
        return (self._at(bottom, right) - self._at(bottom, left)) - (self._at(top, right) - self._at(top, left))

    def _at(self, down: int, right: int) -> Array:
        top, left = self.sums.pad_y - self.step + down, self.sums.pad_x - self.step + right
        bottom, end = top + (self.rows - 1) * self.step + 1, left + (self.columns - 1) * self.step + 1
        return self.sums.sums[top : bottom : self.step, left : end : self.step]


def _second_derivatives(grid: _Grid, size: int) -> tuple[Array, Array, Array]:
    """Twice the sums over the filters Dxx and Dyy, and that over Dxy, (rows, columns) int32."""
    lobe = size // 3
    first, last, more = -(size // 2), (size + 1) // 2, 1 - size % 2
    inner_first, inner_last = -(lobe // 2), (lobe + 1) // 2
    low, high = 1 - lobe, lobe
    xx = sum(
        grid.box(low, high, first + e, last + e) - 3 * grid.box(low, high, inner_first + e, inner_last + e)
        for e in (0, more)
    )
    yy = sum(
        grid.box(first + e, last + e, low, high) - 3 * grid.box(inner_first + e, inner_last + e, low, high)
        for e in (0, more)
    )
    upper, lower = (-lobe, 0), (1, lobe + 1)
    alike = grid.box(*upper, *upper) + grid.box(*lower, *lower)
    return xx, yy, alike - (grid.box(*upper, *lower) + grid.box(*lower, *upper))


def _responses(device: Device, grid: _Grid, size: int) -> tuple[Array, Array]:
    """Determinants (rows, columns) float32 and signs (rows, columns) int8 of the Laplacian."""
    xp = device.xp
    xx, yy, xy = _second_derivatives(grid, size)
    weight, weight_xy = 1.0 / (2 * size * size), BALANCE / (size * size)
    d_xx, d_yy, d_xy = (xp.astype(d, xp.float32) * w for d, w in ((xx, weight), (yy, weight), (xy, weight_xy)))
    positive = xp.astype(xx + yy > 0, xp.int8)
    return d_xx * d_yy - d_xy * d_xy, positive + positive - 1


def _maxima(device: Device, stack: Array, least: Array) -> tuple[Array, Array, Array]:
    """Indices of the maxima above their layer's threshold, in the order of the array."""
    xp = device.xp
    inner = stack[1:-1, 1:-1, 1:-1]
    mask = inner > least[1:-1, None, None]
    layers, rows, columns = inner.shape
    for dk in range(3):
        for dr in range(3):
            for dc in range(3):
                other = stack[dk : dk + layers, dr : dr + rows, dc : dc + columns]
                if (dk, dr, dc) < (1, 1, 1):
                    mask = mask & (inner > other)
                elif (dk, dr, dc) > (1, 1, 1):
                    mask = mask & (inner >= other)
    k, r, c = xp.nonzero(mask)
    return k + 1, r + 1, c + 1


def _offsets(
    device: Device, stack: Array, sizes: Array, at: tuple[Array, Array, Array]
) -> tuple[Array, Array, Array, Array]:
    """Where the parabola through each maximum's neighbours has its own, and its height there."""
    xp = device.xp
    k, r, c = at
    flat, (_, rows, columns) = xp.reshape(stack, (-1,)), stack.shape

    def value(dk: int, dr: int, dc: int) -> Array:
        index = ((k + dk) * rows + (r + dr)) * columns + (c + dc)
        return xp.astype(take(device, flat, index), xp.float64)

    before, here_size, after = (take(device, sizes, k + d) for d in (-1, 0, 1))
    lower, upper = xp.log(here_size / before), xp.log(after / here_size)
    ahead, back = lower / (upper * (lower + upper)), upper / (lower * (lower + upper))
    slopes = [(0.5 * (value(d, 0, 1) - value(d, 0, -1)), 0.5 * (value(d, 1, 0) - value(d, -1, 0))) for d in (-1, 0, 1)]
    here = value(0, 0, 0)
    up, down = value(1, 0, 0) - here, here - value(-1, 0, 0)
    (gx, gy), gs = slopes[1], ahead * up + back * down
    xx = value(0, 0, 1) + value(0, 0, -1) - 2.0 * here
    yy = value(0, 1, 0) + value(0, -1, 0) - 2.0 * here
    ss = 2.0 * (up / upper - down / lower) / (lower + upper)
    xy = 0.25 * (value(0, 1, 1) + value(0, -1, -1) - value(0, 1, -1) - value(0, -1, 1))
    xs = ahead * (slopes[2][0] - gx) + back * (gx - slopes[0][0])
    ys = ahead * (slopes[2][1] - gy) + back * (gy - slopes[0][1])
    a, b, c_ = yy * ss - ys * ys, xs * ys - xy * ss, xy * ys - xs * yy
    d, e, f = xx * ss - xs * xs, xy * xs - xx * ys, xx * yy - xy * xy
    determinant = xx * a + xy * b + xs * c_
    x = -(a * gx + b * gy + c_ * gs) / determinant
    y = -(b * gx + d * gy + e * gs) / determinant
    s = -(c_ * gx + e * gy + f * gs) / determinant
    return x, y, s, here + 0.5 * (gx * x + gy * y + gs * s)


def _in_octave(sums: Sums, shape: tuple[int, int], octave: Octave, threshold: float) -> list[np.ndarray]:
    """Columns x, y, scale, determinant and Laplacian of the maxima whose parabola's lies among their neighbours."""
    device, xp = sums.device, sums.device.xp
    grid = _Grid(sums, shape, octave.step)
    layers = [_responses(device, grid, size) for size in octave.sizes]
    stack, signs = (xp.stack(planes) for planes in zip(*layers, strict=True))
    k, r, c = _maxima(device, stack, device.upload(thresholds(octave.sizes, threshold)))
    sizes = device.upload(np.array(octave.sizes, np.float64))
    with np.errstate(divide="ignore", invalid="ignore"):
        x, y, s, height = _offsets(device, stack, sizes, (k, r, c))
    size = take(device, sizes, k) * xp.exp(s)
    inside = (xp.abs(x) < 1.0) & (xp.abs(y) < 1.0)
    inside = inside & (take(device, sizes, k - 1) < size) & (size < take(device, sizes, k + 1))
    sign = take(device, xp.reshape(signs, (-1,)), (k * stack.shape[1] + r) * stack.shape[2] + c)
    across = (xp.astype(c - 1, xp.float64) + x) * octave.step
    down = (xp.astype(r - 1, xp.float64) + y) * octave.step
    kept = device.download(inside)
    return [device.download(column)[kept] for column in (across, down, SIGMA_PER_SIZE * size, height, sign)]


def detect(sums: Sums, shape: tuple[int, int], octaves: list[Octave], threshold: float) -> Blobs:
    """All maxima of an image of that shape, octave by octave; brought to the host, where they are chosen from."""
    found = [_in_octave(sums, shape, octave, threshold) for octave in octaves]
    x, y, scales, determinants, signs = (np.concatenate(parts) for parts in zip(*found, strict=True))
    return Blobs(np.column_stack([x, y]), scales, determinants * weighted(scales), signs.astype(np.int8))
