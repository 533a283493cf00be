"""Rectification: the maps that turn what two cameras deliver into a :class:`StereoCamera`'s images."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from common.camera import OPTICAL_IN_VEHICLE, StereoCamera
from services.sensors.calibration.errors import CalibrationError
from services.sensors.calibration.rig import Lens, StereoRig

Array = NDArray[np.float64]
Image = NDArray[np.uint8]

_PLAUSIBLE = (0.25, 4.0)
"""Focal length after rectification over that before: outside of it, the images are cut to a corner or to nothing."""
_HALVINGS = 14


@dataclass(frozen=True, slots=True)
class Rectifier:
    """The maps of a rig, computed once.

    Attributes:
        camera: what the rectified images are measured by.
        R_left, R_right: (3, 3) from each camera's own frame to its rectified one.
    """

    camera: StereoCamera
    R_left: Array
    R_right: Array
    _maps: tuple[tuple[Any, Any], tuple[Any, Any]]

    @classmethod
    def of(cls, rig: StereoRig, T_vehicle_camera: Array = OPTICAL_IN_VEHICLE) -> Rectifier:
        """The rectifier of a rig whose rectified left camera is mounted at ``T_vehicle_camera`` (4, 4).

        Every rectified pixel was seen: the images are cut to what both cameras see on all rows.

        Raises:
            CalibrationError: the rig cannot be rectified.
        """
        size = (rig.width, rig.height)
        lenses = (rig.left.matrix, rig.left.distortion, rig.right.matrix, rig.right.distortion)
        R_left, R_right, _, P_right, *_ = cv2.stereoRectify(*lenses, size, rig.R, rig.T.reshape(3, 1))
        baseline = -float(P_right[0, 3] / P_right[0, 0])
        sides = [(lens, np.asarray(R, dtype=np.float64)) for lens, R in ((rig.left, R_left), (rig.right, R_right))]
        K = _widest(sides, size)
        if K is None or baseline <= 0.0:
            raise CalibrationError(
                "the pair cannot be rectified: the two cameras hardly see anything together, or a lens is none"
            )
        f = float(K[0, 0])
        camera = StereoCamera(*size, f, f, float(K[0, 2]), float(K[1, 2]), baseline, T_vehicle_camera)
        # Fixed-point maps: a 32nd of a pixel is finer than what an image tells, and half the work.
        maps = [
            cv2.initUndistortRectifyMap(lens.matrix, lens.distortion, R, K, size, cv2.CV_16SC2) for lens, R in sides
        ]
        return cls(camera, sides[0][1], sides[1][1], (maps[0], maps[1]))

    def rectify(self, left: Image, right: Image) -> tuple[Image, Image]:
        """Rectified images of a pair, grey (H, W) or RGB (H, W, 3)."""
        first, second = (
            np.asarray(cv2.remap(image, *maps, cv2.INTER_LINEAR), dtype=np.uint8)
            for image, maps in zip((left, right), self._maps, strict=True)
        )
        return first, second


def _widest(sides: list[tuple[Lens, Array]], size: tuple[int, int]) -> Array | None:
    """The camera matrix (3, 3) with the shortest focal length at which both cameras see every rectified pixel.

    OpenCV's own choice follows the distortion to the images' corners and beyond, where nothing was measured.
    """
    middle = np.array([[[(size[0] - 1) / 2.0, (size[1] - 1) / 2.0]]])
    aims = [cv2.undistortPoints(middle, lens.matrix, lens.distortion, R=R).reshape(2) for lens, R in sides]
    aim, f = np.mean(aims, axis=0), float(np.mean([lens.fx for lens, _ in sides]))

    def matrix(scale: float) -> Array:
        cx, cy = middle[0, 0] - scale * f * aim
        return np.array([[scale * f, 0.0, cx], [0.0, scale * f, cy], [0.0, 0.0, 1.0]])

    low, high = _PLAUSIBLE
    if not all(_sees_all(lens, R, matrix(high), size) for lens, R in sides):
        return None
    for _ in range(_HALVINGS):
        between = float(np.sqrt(low * high))
        if all(_sees_all(lens, R, matrix(between), size) for lens, R in sides):
            high = between
        else:
            low = between
    return matrix(high)


def _sees_all(lens: Lens, R: Array, K: Array, size: tuple[int, int]) -> bool:
    """Whether a camera sees every pixel of its rectified image: if it does along the border, it does inside."""
    width, height = size
    along, down = np.arange(width, dtype=np.float64), np.arange(height, dtype=np.float64)
    u = np.concatenate([along, along, np.zeros(height), np.full(height, width - 1.0)])
    v = np.concatenate([np.zeros(width), np.full(width, height - 1.0), down, down])
    rays = np.column_stack([u, v, np.ones_like(u)]) @ (R.T @ np.linalg.inv(K)).T
    if (rays[:, 2] <= 0.0).any():
        return False
    rays /= rays[:, 2:]
    points, nearer = (_projected(lens, rays * [scale, scale, 1.0]) for scale in (1.0, 0.98))
    # Far outside of what was measured, a distortion may fold the rays back into the image.
    centre = np.array([lens.cx, lens.cy])
    folded = np.linalg.norm(points - centre, axis=1) <= np.linalg.norm(nearer - centre, axis=1)
    inside = (points >= 0.0).all() and (points <= np.array([width, height]) - 1.0).all()
    return bool(inside and not folded.any())


def _projected(lens: Lens, rays: Array) -> Array:
    """Pixels (N, 2) of rays (N, 3) in the camera's own frame."""
    points = cv2.projectPoints(rays, np.zeros(3), np.zeros(3), lens.matrix, lens.distortion)[0]
    return np.asarray(points, dtype=np.float64).reshape(-1, 2)


def rectified_points(rig: StereoRig, rectifier: Rectifier, left: Array, right: Array) -> tuple[Array, Array]:
    """Where points (N, 2) of the cameras' own images, pixels, lie in the rectified ones."""
    c = rectifier.camera
    K = np.array([[c.fx, 0.0, c.cx], [0.0, c.fy, c.cy], [0.0, 0.0, 1.0]])
    lenses = ((rig.left, rectifier.R_left, left), (rig.right, rectifier.R_right, right))
    criteria = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 50, 1e-9)
    first, second = (
        np.asarray(
            cv2.undistortPoints(points.reshape(-1, 1, 2), lens.matrix, lens.distortion, R=R, P=K, criteria=criteria),
            dtype=np.float64,
        ).reshape(-1, 2)
        for lens, R, points in lenses
    )
    return first, second
