"""Patches, their correlation, and their alignment to a fraction of a pixel.

The alignment is the inverse-compositional one (S. Baker and I. Matthews, *Lucas-Kanade 20 years on*, IJCV 2004): the
gradient is the stored patch's and is computed once. Gain and offset of the brightness are fitted at each step, and the
live image is sampled at the scale at which the landmark is predicted to appear.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from services.estimator.stereo.compiled import kernel

Array = NDArray[np.float64]

PATCH = 13
"""Side of a stored patch, pixels: 11 that are compared, and one on either side for the gradient."""
RADIUS = 5
"""Half side of the compared part, pixels."""
_COUNT = (2 * RADIUS + 1) ** 2
_CONVERGED = 0.01
"""Shift, in pixels, below which the alignment stops."""
_MIN_VARIANCE = 4.0
"""Variance, in squared grey levels, below which a patch is taken as without texture."""


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
def _centre(values: NDArray[np.float32]) -> float:
    """Take the mean off; returns the sum of squares that remains."""
    mean = values.mean()
    total = 0.0
    for k in range(_COUNT):
        values[k] -= mean
        total += values[k] * values[k]
    return total


@kernel
def _template(
    patch: NDArray[np.uint8], template: NDArray[np.float32], gradient: NDArray[np.float32], hessian: Array
) -> float:
    """Write a patch's pixels and gradient without their means, and ``[hxx, hxy, hyy]``; returns the sum of squares.

    A brightness offset is fitted along with a shift: what their derivatives share says nothing about the shift, hence
    the gradient without its mean.
    """
    half = np.float32(0.5)
    k = 0
    for y in range(1, PATCH - 1):
        for x in range(1, PATCH - 1):
            template[k] = patch[y, x]
            gradient[0, k] = (np.float32(patch[y, x + 1]) - np.float32(patch[y, x - 1])) * half
            gradient[1, k] = (np.float32(patch[y + 1, x]) - np.float32(patch[y - 1, x])) * half
            k += 1
    hessian[0], hessian[2] = _centre(gradient[0]), _centre(gradient[1])
    hessian[1] = 0.0
    for k in range(_COUNT):
        hessian[1] += gradient[0, k] * gradient[1, k]
    return _centre(template)


@kernel
def _sample(image: NDArray[np.uint8], u: float, v: float, scale: float, live: NDArray[np.float32]) -> None:
    """Write the pixels around ``(u, v)``, ``scale`` apart, by bilinear interpolation."""
    k = 0
    for dy in range(-RADIUS, RADIUS + 1):
        y = v + dy * scale
        row = int(y)
        fy = np.float32(y - row)
        for dx in range(-RADIUS, RADIUS + 1):
            x = u + dx * scale
            column = int(x)
            fx = np.float32(x - column)
            p00, p01 = np.float32(image[row, column]), np.float32(image[row, column + 1])
            p10, p11 = np.float32(image[row + 1, column]), np.float32(image[row + 1, column + 1])
            top, bottom = p00 + fx * (p01 - p00), p10 + fx * (p11 - p10)
            live[k] = top + fy * (bottom - top)
            k += 1


@kernel
def _step(
    template: NDArray[np.float32], gradient: NDArray[np.float32], hessian: Array, live: NDArray[np.float32], gain: float
) -> tuple[float, float]:
    """Shift of the patch, in its own pixels, that explains the difference best; at most 1 pixel long."""
    factor = np.float32(gain)
    bx = by = 0.0
    for k in range(_COUNT):
        error = factor * live[k] - template[k]
        bx += gradient[0, k] * error
        by += gradient[1, k] * error
    determinant = hessian[0] * hessian[2] - hessian[1] * hessian[1]
    x = (hessian[2] * bx - hessian[1] * by) / determinant
    y = (hessian[0] * by - hessian[1] * bx) / determinant
    # Beyond a pixel the gradient says nothing.
    length = max(math.hypot(x, y), 1.0)
    return x / length, y / length


@kernel
def _align(
    patch: NDArray[np.uint8],
    image: NDArray[np.uint8],
    place: NDArray[np.float32],
    scale: float,
    iterations: int,
    template: NDArray[np.float32],
    gradient: NDArray[np.float32],
    live: NDArray[np.float32],
    hessian: Array,
) -> float:
    """Move ``place`` to where the patch fits; returns the correlation there, as :func:`align` has it."""
    norm = _template(patch, template, gradient, hessian)
    if norm < _MIN_VARIANCE * _COUNT or hessian[0] * hessian[2] - hessian[1] ** 2 <= 1e-3 * hessian[0] * hessian[2]:
        return -1.0
    height, width = image.shape
    reach = RADIUS * scale + 1.0
    u, v, score = float(place[0]), float(place[1]), -1.0
    for _ in range(iterations):
        if not (u >= reach and v >= reach and u + reach < width - 1 and v + reach < height - 1):
            return -1.0
        _sample(image, u, v, scale, live)
        energy = _centre(live)
        if energy < _MIN_VARIANCE * _COUNT:
            return -1.0
        product = 0.0
        for k in range(_COUNT):
            product += live[k] * template[k]
        score = product / math.sqrt(energy * norm)
        x, y = _step(template, gradient, hessian, live, product / energy)
        u -= scale * x
        v -= scale * y
        if x * x + y * y < _CONVERGED**2:
            break
    place[0], place[1] = u, v
    return score


@kernel
def align(
    patches: NDArray[np.uint8],
    image: NDArray[np.uint8],
    starts: NDArray[np.float32],
    scales: NDArray[np.float32],
    iterations: int,
) -> NDArray[np.float32]:
    """Align patches (N, 13, 13) with an image, from places (N, 2) ``[u, v]`` in pixels on.

    ``scales`` (N,) are how many pixels of the image one pixel of the patch covers. Returns rows (N, 3) of the place
    ``[u, v]`` and the correlation there; that is -1 where a patch lacks texture or runs out of the image.
    """
    out = np.empty((patches.shape[0], 3), np.float32)
    template, live = np.empty(_COUNT, np.float32), np.empty(_COUNT, np.float32)
    gradient, hessian = np.empty((2, _COUNT), np.float32), np.empty(3)
    for i in range(patches.shape[0]):
        out[i, :2] = starts[i]
        out[i, 2] = _align(patches[i], image, out[i], scales[i], iterations, template, gradient, live, hessian)
    return out
