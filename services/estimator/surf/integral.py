"""The integral image, and sums over boxes whose edges need not lie between pixels.

An image goes on beyond its edges: its outermost pixels are repeated or, in a panorama, its other side follows. The
integral image is made of the image with a margin of that kind, so that filters need not know the edge.

Linear interpolation of the integral image is the exact integral of an image whose pixels are squares of one value, and
linear extrapolation is that of an image whose outermost pixels are repeated for ever.
"""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from common.compiled import kernel
from services.estimator.surf.features import SurfError

_MOST_PIXELS = (2**31 - 1) // 255


class Integral(NamedTuple):
    """Sums over the rectangles from the corner of an image with a margin.

    Attributes:
        sums: (H + 2 pad_y + 1, W + 2 pad_x + 1) int32; entry ``[i, j]`` sums the first i rows' first j pixels.
        pad_x, pad_y: the margin on either side, pixels. Pixel ``[y, x]`` of the image, the square between x and x + 1,
            lies between columns ``x + pad_x`` and ``x + pad_x + 1`` of the sums.
    """

    sums: NDArray[np.int32]
    pad_x: int
    pad_y: int


def extended(image: NDArray[np.uint8], pad_x: int, pad_y: int, *, wrap: bool) -> NDArray[np.uint8]:
    """The image with a margin: its edges repeated, or left and right its other side.

    Raises:
        SurfError: its sums would exceed 32 bits.
    """
    if (image.shape[0] + 2 * pad_y) * (image.shape[1] + 2 * pad_x) > _MOST_PIXELS:
        raise SurfError(f"an image of {image.shape[1]}x{image.shape[0]} pixels is too large: reduce it to 6 megapixels")
    if wrap:
        columns = np.arange(-pad_x, image.shape[1] + pad_x) % image.shape[1]
        wide = np.ascontiguousarray(np.take(image, columns, axis=1))
    else:
        wide = np.asarray(cv2.copyMakeBorder(image, 0, 0, pad_x, pad_x, cv2.BORDER_REPLICATE), np.uint8)
    return np.asarray(cv2.copyMakeBorder(wide, pad_y, pad_y, 0, 0, cv2.BORDER_REPLICATE), np.uint8)


def integral(wide: NDArray[np.uint8], pad_x: int, pad_y: int) -> Integral:
    """The integral image of an image with its margins."""
    return Integral(np.asarray(cv2.integral(wide), np.int32), pad_x, pad_y)


@kernel
def cell(at: float, size: int) -> tuple[int, float]:
    """The entry before a coordinate, and the coordinate's distance to it; at least one entry follows.

    Outside the sums it is the outermost entry with a distance that extrapolates.
    """
    first = min(max(int(np.floor(at)), 0), size - 2)
    return first, at - first


@kernel
def box_mean(sums: NDArray[np.int32], u: float, v: float, half: float) -> float:
    """Mean over the square of half side ``half`` around ``(u, v)``, in coordinates of the sums."""
    height, width = sums.shape
    left, f_left = cell(u - half, width)
    right, f_right = cell(u + half, width)
    top, f_top = cell(v - half, height)
    bottom, f_bottom = cell(v + half, height)
    total = 0.0
    for row, f, sign in ((bottom, f_bottom, 1.0), (top, f_top, -1.0)):
        first = _between(sums[row], left, f_left, right, f_right)
        second = _between(sums[row + 1], left, f_left, right, f_right)
        total += sign * (first + f * (second - first))
    return total / (4.0 * half * half)


@kernel
def _between(row: NDArray[np.int32], left: int, f_left: float, right: int, f_right: float) -> float:
    """Difference of a row of the sums between two columns."""
    whole = float(np.int64(row[right]) - np.int64(row[left]))
    after_right = float(np.int64(row[right + 1]) - np.int64(row[right]))
    after_left = float(np.int64(row[left + 1]) - np.int64(row[left]))
    return whole + f_right * after_right - f_left * after_left
