"""A first estimate of each camera by itself, by OpenCV's own calibration."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from services.sensors.calibration.detection import Detection
from services.sensors.calibration.errors import CalibrationError
from services.sensors.calibration.rig import Lens

Array = NDArray[np.float64]

Coefficients = Literal[5, 8]
"""Of the distortion: 5 serve up to some 90 degrees of view, 8 beyond."""

_POLYNOMIAL = 5
_PLAUSIBLE = (0.2, 20.0)
"""Focal length over the image's width: from 136 down to 3 degrees of view."""


@dataclass(frozen=True, slots=True)
class Monocular:
    """One camera by itself: its lens, the board's poses (V, 6), rotation vector and translation, errors (V,) pixels."""

    lens: Lens
    poses: Array
    errors: Array


def calibrate_camera(
    detections: Sequence[Detection], objects: Array, size: tuple[int, int], coefficients: Coefficients, side: str
) -> Monocular:
    """A camera from its views of the board; ``objects`` (N, 3) are its corners, metres, ``side`` names it in errors.

    Raises:
        CalibrationError: the views do not determine a lens.
    """
    try:
        _, matrix, distortion, rotations, translations, _, _, errors = cv2.calibrateCameraExtended(
            [objects[d.ids].astype(np.float32) for d in detections],
            [d.points.astype(np.float32) for d in detections],
            size,
            np.eye(3),
            np.zeros(_POLYNOMIAL),
        )
    except cv2.error:
        raise CalibrationError(_undetermined(side)) from None
    known = np.asarray(distortion, dtype=np.float64).ravel()[:_POLYNOMIAL]
    # The rational model begins without its denominator, which the joint refinement adds.
    lens = Lens.of(np.asarray(matrix, dtype=np.float64), np.pad(known, (0, coefficients - _POLYNOMIAL)))
    poses = np.concatenate([np.asarray(rotations).reshape(-1, 3), np.asarray(translations).reshape(-1, 3)], axis=1)
    ratio = np.array([lens.fx, lens.fy]) / size[0]
    if not (np.isfinite(poses).all() and (_PLAUSIBLE[0] < ratio).all() and (ratio < _PLAUSIBLE[1]).all()):
        raise CalibrationError(_undetermined(side))
    return Monocular(lens, poses, np.asarray(errors, dtype=np.float64).ravel())


def _undetermined(side: str) -> str:
    return (
        f"the views do not determine the lens of the {side} camera: tilt the board by 30 degrees and more, "
        "to all sides, near and far, and into the corners of the image"
    )
