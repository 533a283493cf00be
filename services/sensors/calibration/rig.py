"""Two cameras as they are: their lenses and how they stand to each other."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Lens:
    """A camera's projection by OpenCV's model.

    Attributes:
        fx, fy, cx, cy: focal lengths and principal point, pixels; the middle of the first pixel is (0, 0).
        distortion: (5,) ``k1 k2 p1 p2 k3``, or (8,) with ``k4 k5 k6`` of the rational model as well.
    """

    fx: float
    fy: float
    cx: float
    cy: float
    distortion: Array

    @property
    def matrix(self) -> Array:
        """The camera matrix (3, 3)."""
        return np.array([[self.fx, 0.0, self.cx], [0.0, self.fy, self.cy], [0.0, 0.0, 1.0]])

    @classmethod
    def of(cls, matrix: Array, distortion: Array) -> Lens:
        """From OpenCV's camera matrix (3, 3) and coefficients."""
        fx, fy, cx, cy = (float(matrix[i]) for i in ((0, 0), (1, 1), (0, 2), (1, 2)))
        return cls(fx, fy, cx, cy, np.asarray(distortion, dtype=np.float64).ravel())


@dataclass(frozen=True, slots=True)
class StereoRig:
    """A stereo pair, not rectified.

    Attributes:
        width, height: of either image, pixels.
        left, right: the lenses.
        R, T: (3, 3) and (3,) metres: ``p_right = R p_left + T``, both in optical frames (z forward, x right, y down).
    """

    width: int
    height: int
    left: Lens
    right: Lens
    R: Array
    T: Array

    @property
    def baseline(self) -> float:
        """Distance of the optical centres, metres."""
        return float(np.linalg.norm(self.T))

    @property
    def turn(self) -> Array:
        """The rotation vector (3,) of ``R``, radians."""
        return np.asarray(cv2.Rodrigues(self.R)[0], dtype=np.float64).ravel()
