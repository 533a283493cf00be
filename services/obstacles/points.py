"""What a sensor sees as points in the vehicle frame (x forward, y left, z up; its origin is on the ground)."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from common.camera import StereoCamera
from common.geometry import Array

Image = NDArray[np.uint8]

_DISPARITY_STEPS = 16
"""OpenCV's disparities are whole sixteenths of a pixel."""


def of_scan(ranges: NDArray[np.float32], elevations: Array, azimuths: Array, T_vehicle_lidar: Array) -> Array:
    """Points (N, 3) of an organised scan of ranges (H, W), 0 where nothing came back.

    Elevations (H,) or (H, W) and azimuths (W,) or (H, W), radians, in the lidar's frame. The motion within the turn is
    left alone: at walking pace it moves a point by less than a zone's margin.
    """
    rows = elevations if elevations.ndim == 2 else elevations[:, None]
    columns = azimuths if azimuths.ndim == 2 else azimuths[None, :]
    seen = ranges > 0.0
    flat = np.cos(rows) * ranges
    x, y, z = np.broadcast_to(flat * np.cos(columns), ranges.shape), flat * np.sin(columns), np.sin(rows) * ranges
    points = np.stack([x[seen], y[seen], np.broadcast_to(z, ranges.shape)[seen]], axis=1, dtype=np.float64)
    return _moved(points, T_vehicle_lidar)


class StereoPoints:
    """Dense stereo at a reduced size: semi-global matching, as OpenCV has it.

    Attributes:
        seen: the part of the last pair in which anything was measured.
    """

    def __init__(self, camera: StereoCamera, width: int, nearest: float) -> None:
        """For images shrunk to about ``width`` pixels, and things no nearer than ``nearest`` metres."""
        self.camera = camera
        self._scale = min(width / camera.width, 1.0)
        self._size = round(camera.width * self._scale), round(camera.height * self._scale)
        disparity = camera.fx * self._scale * camera.baseline / nearest
        most = int(np.ceil(disparity / _DISPARITY_STEPS)) * _DISPARITY_STEPS
        self._most = most
        self._columns = np.arange(self._size[0])
        self.seen = 0.0
        self._matcher = cv2.StereoSGBM.create(
            minDisparity=0,
            numDisparities=most,
            blockSize=5,
            P1=8 * 25,
            P2=32 * 25,
            uniquenessRatio=10,
            speckleWindowSize=60,
            speckleRange=2,
            disp12MaxDiff=1,
        )
        v, u = np.indices(self._size[::-1], dtype=np.float64)
        scale = self._scale
        self._across = (u - camera.cx * scale) / (camera.fx * scale)
        self._down = (v - camera.cy * scale) / (camera.fy * scale)

    def of_pair(self, left: Image, right: Image) -> Array:
        """Points (N, 3) of a rectified pair, grey or RGB."""
        # The matcher finds nothing in as many columns on the left as there are disparities.
        padded = [
            cv2.copyMakeBorder(self._small(image), 0, 0, self._most, 0, cv2.BORDER_CONSTANT) for image in (left, right)
        ]
        disparity = self._matcher.compute(*padded)[:, self._most :].astype(np.float64) / _DISPARITY_STEPS
        seen = (disparity > 0.5) & (disparity <= self._columns)
        self.seen = float(seen.mean())
        z = self.camera.fx * self._scale * self.camera.baseline / disparity[seen]
        optical = np.stack([self._across[seen] * z, self._down[seen] * z, z], axis=1)
        return _moved(optical, self.camera.T_vehicle_camera)

    def _small(self, image: Image) -> Image:
        small = cv2.resize(image, self._size, interpolation=cv2.INTER_AREA)
        return small if small.ndim == 2 else cv2.cvtColor(small, cv2.COLOR_RGB2GRAY)  # type: ignore[return-value]


def _moved(points: Array, T: Array) -> Array:
    moved: Array = points @ T[:3, :3].T + T[:3, 3]
    return moved
