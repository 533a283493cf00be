"""Images as they come in for registration: checked, grey, and brought to the width at which they are compared."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from common.errors import ImageError

Image = NDArray[np.uint8]
"""(H, W) grey or (H, W, 3) RGB."""

MIN_SIZE = 16
"""Smallest height and width that can be compared, pixels."""

MAX_ASPECT = 4
"""Largest height that can be compared, in widths."""


def check(image: NDArray[np.generic]) -> Image:
    """The image itself, as 8 bits a value; booleans and a single channel's own axis are accepted.

    Raises:
        ImageError: it is no (H, W) or (H, W, 3) image of 8 bits, or too small.
    """
    if image.ndim == 3 and image.shape[2] == 1:
        image = image[:, :, 0]
    if image.dtype != np.uint8 or image.ndim not in {2, 3} or (image.ndim == 3 and image.shape[2] != 3):
        raise ImageError(f"an image of {image.dtype} {image.shape} is neither 8-bit grey nor 8-bit RGB: convert it")
    height, width = image.shape[:2]
    if min(height, width) < MIN_SIZE:
        raise ImageError(f"an image of {width}x{height} is too small: {MIN_SIZE} pixels a side are needed")
    if height > MAX_ASPECT * width:
        raise ImageError(f"an image of {width}x{height} is too narrow to tell a horizontal shift")
    return image  # type: ignore[return-value]  # the type has just been checked


def resized(image: Image, width: int, height: int | None = None) -> Image:
    """The image at another size, its aspect kept unless a height is given; every pixel of the original counts."""
    height = height or max(1, round(image.shape[0] * width / image.shape[1]))
    if image.shape[:2] == (height, width):
        return image
    method = cv2.INTER_AREA if width < image.shape[1] else cv2.INTER_LINEAR
    return np.asarray(cv2.resize(image, (width, height), interpolation=method), dtype=np.uint8)


def grey(image: Image) -> Image:
    """The image's luminance (H, W)."""
    return image if image.ndim == 2 else np.asarray(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY), dtype=np.uint8)


def colour(image: Image) -> Image:
    """The image as (H, W, 3) RGB."""
    return image if image.ndim == 3 else np.repeat(image[:, :, None], 3, axis=2)
