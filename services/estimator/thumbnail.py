"""The small picture that a vertex keeps for people to look at."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

_WIDTH = 200
_JPEG_QUALITY = 80


def thumbnail(image: NDArray[np.uint8], width: int = _WIDTH) -> bytes:
    """A small JPEG of an image, (H, W) grey or (H, W, 3) RGB."""
    height = max(1, round(image.shape[0] * width / image.shape[1]))
    small = cv2.resize(image, (width, height), interpolation=cv2.INTER_AREA)
    bgr = small if small.ndim == 2 else cv2.cvtColor(small, cv2.COLOR_RGB2BGR)
    ok, data = cv2.imencode(".jpg", bgr, [cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY])
    return bytes(data) if ok else b""
