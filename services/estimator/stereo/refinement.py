"""Patches, their correlation, and their alignment to a fraction of a pixel.

The alignment is the inverse-compositional one (S. Baker and I. Matthews, *Lucas-Kanade 20 years on*, IJCV 2004): the
gradient is the stored patch's and is computed once. Gain and offset of the brightness are fitted at each step, and the
live image is sampled through the affine warp under which the patch is predicted to appear.

A patch on a surface that leans, the ground before all, is sheared between the two images of a pair: its disparity
changes from row to row, on flat ground by the baseline over the camera's height. An alignment that does not know of it
is off by a third of a pixel, whichever rows happen to have texture; so between the images of a pair this *slant* is
fitted as well. Each alignment comes with its covariance: what the fit left over, seen through the patch's gradient.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from common.compiled import kernel
from services.estimator.solving import normal_equations

Array = NDArray[np.float64]
Array32 = NDArray[np.float32]

PATCH = 13
"""Side of a stored patch, pixels: 11 that are compared, and one on either side for the gradient."""
RADIUS = 5
"""Half side of the compared part, pixels."""
_COUNT = (2 * RADIUS + 1) ** 2
_CONVERGED = 0.03
"""Shift, in pixels, below which the alignment stops."""
_MIN_VARIANCE = 4.0
"""Variance, in squared grey levels, below which a patch is taken as without texture."""
_SLANT_PRIOR = 0.5
"""What holds the slant near zero: the patch's variance times this, as for a slant of 0.3 and a fit of 0.98."""
_CORRELATED_PIXELS = 3.0
"""Pixels whose errors go together: so many fewer than a patch's pixels are independent measurements."""


@kernel
def _extract(image: NDArray[np.uint8], places: NDArray[np.int32]) -> NDArray[np.uint8]:
    half = PATCH // 2
    out = np.empty((places.shape[0], PATCH, PATCH), np.uint8)
    for i in range(places.shape[0]):
        for y in range(PATCH):
            for x in range(PATCH):
                out[i, y, x] = image[places[i, 1] + y - half, places[i, 0] + x - half]
    return out


def extract(image: NDArray[np.uint8], places: NDArray[np.int32]) -> NDArray[np.uint8]:
    """Patches (N, 13, 13) around places (N, 2) ``[x, y]``, each at least 6 pixels inside the image."""
    return _extract(image, places)


@kernel
def correlation(a: NDArray[np.uint8], ax: int, ay: int, b: NDArray[np.uint8], bx: int, by: int) -> float:
    """Zero-mean normalised cross-correlation of the 11 x 11 pixels around two places, -1 to 1; 0 without texture."""
    sum_a = sum_b = sum_aa = sum_bb = sum_ab = np.int64(0)
    for dy in range(-RADIUS, RADIUS + 1):
        for dx in range(-RADIUS, RADIUS + 1):
            p, q = np.int64(a[ay + dy, ax + dx]), np.int64(b[by + dy, bx + dx])
            sum_a += p
            sum_b += q
            sum_aa += p * p
            sum_bb += q * q
            sum_ab += p * q
    variance_a = sum_aa - sum_a * sum_a / _COUNT
    variance_b = sum_bb - sum_b * sum_b / _COUNT
    if variance_a < _MIN_VARIANCE * _COUNT or variance_b < _MIN_VARIANCE * _COUNT:
        return 0.0
    return float((sum_ab - sum_a * sum_b / _COUNT) / math.sqrt(variance_a * variance_b))


@kernel
def _centre(values: Array32) -> float:
    """Take the mean off; returns the sum of squares that remains."""
    mean = values.mean()
    total = 0.0
    for k in range(_COUNT):
        values[k] -= mean
        total += values[k] * values[k]
    return total


@kernel
def _template(patch: NDArray[np.uint8], template: Array32, gradient: Array32, hessian: Array) -> float:
    """Write a patch's pixels and gradient (n, 121) without their means, and the Hessian (n, n).

    The rows of ``gradient`` are by a shift along x and along y and, where there is a third, by the slant. A brightness
    offset is fitted along with them: what their derivatives share says nothing, hence the gradient without its mean.
    Returns the template's sum of squares.
    """
    half = np.float32(0.5)
    n, k = gradient.shape[0], 0
    for y in range(1, PATCH - 1):
        for x in range(1, PATCH - 1):
            template[k] = patch[y, x]
            gradient[0, k] = (np.float32(patch[y, x + 1]) - np.float32(patch[y, x - 1])) * half
            gradient[1, k] = (np.float32(patch[y + 1, x]) - np.float32(patch[y - 1, x])) * half
            if n > 2:
                gradient[2, k] = -gradient[0, k] * (y - PATCH // 2)
            k += 1
    for a in range(n):
        hessian[a, a] = _centre(gradient[a])
        for b in range(a):
            total = np.float32(0.0)
            for k in range(_COUNT):
                total += gradient[a, k] * gradient[b, k]
            hessian[a, b] = hessian[b, a] = total
    norm = _centre(template)
    if n > 2:
        hessian[2, 2] += _SLANT_PRIOR * norm / _COUNT
    return norm


@kernel
def _sample(image: NDArray[np.uint8], u: float, v: float, warp: Array, live: Array32) -> None:
    """Write the pixels around ``(u, v)`` under a warp (2, 2), by bilinear interpolation."""
    k = 0
    for dy in range(-RADIUS, RADIUS + 1):
        for dx in range(-RADIUS, RADIUS + 1):
            x, y = u + warp[0, 0] * dx + warp[0, 1] * dy, v + warp[1, 0] * dx + warp[1, 1] * dy
            column, row = int(x), int(y)
            fx, fy = np.float32(x - column), np.float32(y - row)
            p00, p01 = np.float32(image[row, column]), np.float32(image[row, column + 1])
            p10, p11 = np.float32(image[row + 1, column]), np.float32(image[row + 1, column + 1])
            top, bottom = p00 + fx * (p01 - p00), p10 + fx * (p11 - p10)
            live[k] = top + fy * (bottom - top)
            k += 1


@kernel
def _step(template: Array32, gradient: Array32, inverse: Array, live: Array32, gain: float, step: Array) -> None:
    """Write the change of the parameters that explains the difference best; a shift of at most 1 pixel."""
    n = gradient.shape[0]
    factor = np.float32(gain)
    bx = by = bs = np.float32(0.0)
    for k in range(_COUNT):
        error = factor * live[k] - template[k]
        bx += gradient[0, k] * error
        by += gradient[1, k] * error
        if n > 2:
            bs += gradient[2, k] * error
    for a in range(n):
        step[a] = inverse[a, 0] * bx + inverse[a, 1] * by
        if n > 2:
            step[a] += inverse[a, 2] * bs
    # Beyond a pixel the gradient says nothing.
    length = max(math.hypot(step[0], step[1]), 1.0)
    for a in range(n):
        step[a] /= length


@kernel
def _invert(hessian: Array, inverse: Array) -> bool:
    """Write the inverse (n, n); False for a patch that can slide along itself."""
    if hessian[0, 0] * hessian[1, 1] - hessian[0, 1] ** 2 <= 1e-3 * hessian[0, 0] * hessian[1, 1]:
        return False
    n = hessian.shape[0]
    unit, column = np.zeros(n), np.zeros(n)
    for a in range(n):
        unit[:] = 0.0
        unit[a] = 1.0
        if not normal_equations.cholesky_solve(hessian.copy(), unit, column):
            return False
        inverse[a] = column
    return True


@kernel
def _is_inside(u: float, v: float, warp: Array, shape: tuple[int, int]) -> bool:
    """Whether all the pixels that :func:`_sample` reads are in an image of this shape."""
    reach_u = RADIUS * (abs(warp[0, 0]) + abs(warp[0, 1])) + 1.0
    reach_v = RADIUS * (abs(warp[1, 0]) + abs(warp[1, 1])) + 1.0
    return bool(u >= reach_u and v >= reach_v and u + reach_u < shape[1] - 1 and v + reach_v < shape[0] - 1)


@kernel
def _write_covariance(warp: Array, inverse: Array, variance: float, row: Array32) -> None:
    """Write the place's covariance ``[uu, uv, vv]``, which a shift in the patch of covariance ``inverse`` has there."""
    for a in range(2):
        for b in range(a, 2):
            total = 0.0
            for p in range(2):
                for q in range(2):
                    total += warp[a, p] * inverse[p, q] * warp[b, q]
            row[3 + a + b] = variance * total


@kernel
def _align(
    patch: NDArray[np.uint8],
    image: NDArray[np.uint8],
    warp: Array,
    iterations: int,
    template: Array32,
    gradient: Array32,
    live: Array32,
    hessian: Array,
    inverse: Array,
    step: Array,
    row: Array32,
) -> None:
    """Write a row of :func:`align`, or of :func:`align_pair` where ``gradient`` has three rows; starts from it too."""
    row[2] = -1.0
    norm = _template(patch, template, gradient, hessian)
    if norm < _MIN_VARIANCE * _COUNT or not _invert(hessian, inverse):
        return
    slanted = gradient.shape[0] > 2
    u, v, score = float(row[0]), float(row[1]), -1.0
    for _ in range(iterations):
        if not _is_inside(u, v, warp, image.shape):
            return
        _sample(image, u, v, warp, live)
        energy = _centre(live)
        if energy < _MIN_VARIANCE * _COUNT:
            return
        product = 0.0
        for k in range(_COUNT):
            product += live[k] * template[k]
        score = product / math.sqrt(energy * norm)
        _step(template, gradient, inverse, live, product / energy, step)
        u -= warp[0, 0] * step[0] + warp[0, 1] * step[1]
        v -= warp[1, 0] * step[0] + warp[1, 1] * step[1]
        if slanted:
            warp[0, 1] += step[2]
        if step[0] ** 2 + step[1] ** 2 < _CONVERGED**2:
            break
    left_over = _CORRELATED_PIXELS * max(1.0 - score * score, 0.0) * norm / _COUNT
    row[0], row[1], row[2] = u, v, score
    if slanted:
        row[3], row[4] = -warp[0, 1], left_over * inverse[0, 0]
    else:
        _write_covariance(warp, inverse, left_over, row)


@kernel
def align(
    patches: NDArray[np.uint8], image: NDArray[np.uint8], starts: Array32, warps: Array32, iterations: int
) -> Array32:
    """Align patches (N, 13, 13) with an image, from places (N, 2) ``[u, v]`` in pixels on.

    ``warps`` (N, 2, 2) take an offset in the patch to the offset in the image. Returns rows (N, 6) of the place
    ``[u, v]``, the correlation there and the place's covariance ``[uu, uv, vv]``, square pixels; the correlation is -1
    where a patch lacks texture or runs out of the image.
    """
    out = np.zeros((patches.shape[0], 6), np.float32)
    template, live, gradient = (
        np.empty(_COUNT, np.float32),
        np.empty(_COUNT, np.float32),
        np.empty((2, _COUNT), np.float32),
    )
    hessian, inverse, step, warp = np.empty((2, 2)), np.empty((2, 2)), np.empty(2), np.empty((2, 2))
    for i in range(patches.shape[0]):
        out[i, :2] = starts[i]
        warp[:] = warps[i]
        _align(patches[i], image, warp, iterations, template, gradient, live, hessian, inverse, step, out[i])
    return out


@kernel
def align_pair(patches: NDArray[np.uint8], right: NDArray[np.uint8], starts: Array32, iterations: int) -> Array32:
    """Align patches (N, 13, 13) of a pair's left image with its right one, from places (N, 2) on.

    Returns rows (N, 5) of the place ``[u, v]``, the correlation there (-1 as in :func:`align`), the slant, in pixels of
    disparity a row, and the variance of u, square pixels.
    """
    out = np.zeros((patches.shape[0], 5), np.float32)
    template, live, gradient = (
        np.empty(_COUNT, np.float32),
        np.empty(_COUNT, np.float32),
        np.empty((3, _COUNT), np.float32),
    )
    hessian, inverse, step, warp = np.empty((3, 3)), np.empty((3, 3)), np.empty(3), np.empty((2, 2))
    for i in range(patches.shape[0]):
        out[i, :2] = starts[i]
        warp[:] = np.eye(2)
        _align(patches[i], right, warp, iterations, template, gradient, live, hessian, inverse, step, out[i])
    return out
