"""Compilation of every loop before the first frame: at start it delays nobody, on a frame it does."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np

from common.camera import StereoCamera
from common.geometry import Uncertain
from services.estimator.stereo.localization import StereoLocalizer
from services.estimator.stereo.odometry import StereoOdometry
from services.estimator.stereo.settings import StereoSettings
from services.estimator.stereo.window import WindowAdjuster


def warm_up(camera: StereoCamera, settings: StereoSettings | None = None) -> None:
    """Run the whole pipeline once on a pair of textured images, so that everything is compiled or read from disk."""
    used = settings or StereoSettings()
    texture = np.random.default_rng(1).integers(0, 255, (camera.height // 4 + 1, camera.width // 4 + 1), dtype=np.uint8)
    image = cv2.resize(texture, None, fx=4.0, fy=4.0, interpolation=cv2.INTER_CUBIC)[: camera.height, : camera.width]
    left, right = np.ascontiguousarray(image), np.ascontiguousarray(np.roll(image, -12, axis=1))
    # Every pair is a keyframe here, or the window would never have two.
    always = replace(used, odometry=replace(used.odometry, keyframe_distance=-1.0))
    adjuster = WindowAdjuster(camera, always, synchronous=True) if used.bundle.enabled else None
    odometry = StereoOdometry(camera, always, adjuster)
    odometry.process(left, right, 0)
    result = odometry.process(left, right, 100_000_000)
    prior = Uncertain(np.eye(4), np.diag(np.repeat([0.1, 0.01], 3) ** 2))
    StereoLocalizer(camera, used).localize(result.frame.features, result.frame, prior)
