"""What the camera, or the lidar, sees, as a small JPEG."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from common.messages import LidarScan

_WIDTH = 640
_LIDAR_ROW = 4
"""A scan has fewer rows than columns: each is drawn so many times, for people."""


def jpeg(image: NDArray[np.uint8], quality: int) -> tuple[bytes, float]:
    """A JPEG of an image, (H, W) grey or (H, W, 3) RGB, at most 640 pixels wide, and the scale that it has."""
    scale = min(1.0, _WIDTH / image.shape[1])
    if scale < 1.0:
        image = cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)  # type: ignore[assignment]
    bgr = image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_RGB2BGR)
    _, data = cv2.imencode(".jpg", bgr, [cv2.IMWRITE_JPEG_QUALITY, quality])
    return data.tobytes(), scale


def lidar_image(scan: LidarScan) -> NDArray[np.uint8]:
    """A scan as the estimator looks at it: intensity times range, each row drawn four times."""
    product = scan.intensities.astype(np.float32) * scan.ranges
    most = float(np.percentile(product, 99)) or 1.0
    grey: NDArray[np.uint8] = np.clip(product * (255.0 / most), 0, 255).astype(np.uint8)
    return np.repeat(grey, _LIDAR_ROW, axis=0)


def on_lidar_image(pixels: NDArray[np.float32]) -> NDArray[np.float32]:
    """Where columns and rows (N, 2) of a scan lie in its :func:`lidar_image`."""
    middle = np.array([0.0, (_LIDAR_ROW - 1) / 2.0], np.float32)
    return pixels * np.array([1.0, _LIDAR_ROW], np.float32) + middle


def header(stamp: int, image: NDArray[np.uint8], scale: float, pixels: NDArray[np.float32] | None) -> dict[str, Any]:
    """What is drawn over the picture: ``points`` are x, y of matched features, in its own pixels."""
    points = [] if pixels is None else np.round(pixels * scale).astype(int).ravel().tolist()
    return {
        "stamp": stamp,
        "width": round(image.shape[1] * scale),
        "height": round(image.shape[0] * scale),
        "points": points,
    }
