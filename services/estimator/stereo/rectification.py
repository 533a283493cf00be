"""What remains of the rectification: a small, slowly changing error of the disparity, estimated while driving.

A stereo rig's cameras turn against each other with temperature and vibration. Of that turn the part about the vertical
axis is the harmful one: it changes every disparity by nearly the same fraction of a pixel, which stretches far depths
far more than near ones, and with them the motion. Its two effects, a shift of the principal point and a perspective
one that grows with the square of the distance from the image's middle, are estimated along with the motion: depths
near and far agree on the motion with the right correction alone.

The correction is ``d_true = d_measured - (c0 + c1 x^2)`` with ``x = (u - cx) / fx``; c0 and c1 are in pixels.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from common.camera import StereoCamera
from services.estimator.stereo.features import FeatureSet
from services.estimator.stereo.settings import NoiseSettings

Array = NDArray[np.float64]

PARAMETERS = 2


@dataclass(frozen=True, slots=True)
class Rectification:
    """The disparity's error ``[c0, c1]`` (2,), pixels, with its covariance (2, 2)."""

    mean: Array
    covariance: Array

    @classmethod
    def unknown(cls, noise: NoiseSettings) -> Rectification:
        """As calibrated, within what ``noise`` says of the calibration."""
        sigma = np.array([noise.disparity_offset, noise.disparity_curvature])
        return cls(np.zeros(PARAMETERS), np.diag(sigma**2))

    def updated(self, change: Array, covariance: Array, noise: NoiseSettings) -> Rectification:
        """After a ``change`` (2,) of the mean was measured, with ``covariance``, which grows by the rig's own."""
        walk = np.array([noise.disparity_offset, noise.disparity_curvature]) * noise.rectification_walk
        return Rectification(self.mean + change, covariance + np.diag(walk**2))

    def disparity_error(self, u: NDArray[np.float32] | Array, camera: StereoCamera) -> Array:
        """Error (N,) of the disparities of features at columns ``u`` (N,), pixels."""
        x = (np.asarray(u, dtype=np.float64) - camera.cx) / camera.fx
        return np.asarray(self.mean[0] + self.mean[1] * x * x)


def triangulate(
    features: FeatureSet, camera: StereoCamera, noise: NoiseSettings, rectification: Rectification, min_disparity: float
) -> FeatureSet:
    """The features with landmarks and covariances from their measurements, corrected for the rectification's error.

    The place in the left image and the disparity carry independent noise; to first order the landmark's covariance is
    ``J R J^T``, so that depth's standard deviation is ``z^2 sigma_d / (f b)``: it grows with the square of the depth.
    Features of less than ``min_disparity`` pixels are left out.
    """
    m = features.measurements.astype(np.float64)
    disparity = m[:, 0] - m[:, 2] - rectification.disparity_error(m[:, 0], camera)
    far = disparity < min_disparity
    if far.any():
        return triangulate(features.select(~far), camera, noise, rectification, min_disparity)
    z = camera.fx * camera.baseline / disparity
    ray = np.stack([(m[:, 0] - camera.cx) / camera.fx, (m[:, 1] - camera.cy) / camera.fy, np.ones_like(z)], axis=-1)
    jacobian = np.zeros((len(z), 3, 3))
    jacobian[:, 0, 0], jacobian[:, 1, 1] = z / camera.fx, z / camera.fy
    jacobian[:, :, 2] = -ray * (z / disparity)[:, None]
    jacobian[:, :, :2] *= noise.landmark_pixel
    jacobian[:, :, 2] *= features.disparity_sigmas[:, None]
    return replace(
        features,
        landmarks=(ray * z[:, None]).astype(np.float32),
        covariances=(jacobian @ jacobian.transpose(0, 2, 1)).astype(np.float32),
        depths=z.astype(np.float32),
    )
