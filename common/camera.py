"""The rectified stereo camera: its calibration and its measurement model."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

Transfer = float | Literal["srgb"]
"""How linear intensities became grey levels: by the power ``1 / gamma``, given as gamma, or by sRGB's curve."""


@dataclass(frozen=True, slots=True)
class StereoCamera:
    """A rectified stereo pair: pixels of the left image, and the same focal lengths in both.

    Attributes:
        width, height: image size, pixels.
        fx, fy, cx, cy: focal lengths and principal point, pixels.
        baseline: distance from the left to the right optical centre, metres, positive.
        T_vehicle_camera: (4, 4), from the left camera's optical frame (z forward, x right, y down)
            to the vehicle frame (x forward, y left, z up).
        wavelengths: where red, green and blue are most sensitive, metres; None where it is unknown, or a grey camera.
        transfer: the transfer curve, 1 where grey levels are proportional to the light.
    """

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    baseline: float
    T_vehicle_camera: Array = field(default_factory=lambda: np.array(OPTICAL_IN_VEHICLE))
    wavelengths: tuple[float, float, float] | None = None
    transfer: Transfer = 1.0

    def project(self, points: ArrayLike) -> Array:
        """Measurements (..., 3) ``[u_left, v, u_right]`` in pixels of points (..., 3) in the optical frame, metres."""
        p = np.asarray(points, dtype=np.float64)
        x, y, z = p[..., 0], p[..., 1], p[..., 2]
        u = self.fx * x / z + self.cx
        return np.stack([u, self.fy * y / z + self.cy, u - self.fx * self.baseline / z], axis=-1)

    def triangulate(self, measurements: ArrayLike) -> Array:
        """Points (..., 3) in the optical frame, metres, of measurements (..., 3) ``[u_left, v, u_right]``."""
        m = np.asarray(measurements, dtype=np.float64)
        z = self.fx * self.baseline / (m[..., 0] - m[..., 2])
        return np.stack([(m[..., 0] - self.cx) * z / self.fx, (m[..., 1] - self.cy) * z / self.fy, z], axis=-1)

    def jacobian(self, points: ArrayLike) -> Array:
        """Derivatives (..., 3, 3) of :meth:`project` by the point's coordinates."""
        p = np.asarray(points, dtype=np.float64)
        x, y, z = p[..., 0], p[..., 1], p[..., 2]
        out = np.zeros((*z.shape, 3, 3))
        out[..., 0, 0] = out[..., 2, 0] = self.fx / z
        out[..., 0, 2] = -self.fx * x / z**2
        out[..., 1, 1] = self.fy / z
        out[..., 1, 2] = -self.fy * y / z**2
        out[..., 2, 2] = -self.fx * (x - self.baseline) / z**2
        return out


OPTICAL_IN_VEHICLE: Array = np.array(
    [[0.0, 0.0, 1.0, 0.0], [-1.0, 0.0, 0.0, 0.0], [0.0, -1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]]
)
"""Rotation from an optical frame that looks along the vehicle's x axis to the vehicle frame (REP-103)."""
