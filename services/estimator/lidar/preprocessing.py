"""First stage, preprocessing: a scan becomes metric keypoints. It knows no map and no motion."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from common.geometry import Array
from common.lidar import LidarScan
from services.estimator.lidar import images, keypoints
from services.estimator.lidar.agreement import RangeImage
from services.estimator.lidar.beams import StackGeometry
from services.estimator.lidar.features import LidarFeatures
from services.estimator.lidar.settings import LidarSettings
from services.estimator.surf import detect_and_describe

Image = NDArray[np.uint8]


@dataclass(frozen=True, slots=True)
class LidarFrame:
    """A preprocessed scan.

    Attributes:
        stamp_ns: of the scan, nanoseconds.
        features: what was found in it; odometry brings them to the frame of the stamp.
        brightness: (H, W) uint8, the image that they were found in.
        ranges: by direction, as measured.
        correction: (6, 6) covariance of the pose, in the scan's frame, by what is not known of the motion in the turn.
    """

    stamp_ns: int
    features: LidarFeatures
    brightness: Image
    ranges: RangeImage
    correction: Array = field(default_factory=lambda: np.zeros((6, 6)))


def preprocess(scan: LidarScan, geometry: StackGeometry, settings: LidarSettings) -> LidarFrame:
    """Image formation, SURF on the brightness, and the keypoints' measurements.

    The scan is one that :func:`services.estimator.lidar.scan.check` lets pass.

    Raises:
        ScanError: the scan does not fit the lidar's geometry.
    """
    stack = images.form(scan, geometry, settings.image)
    found = detect_and_describe(stack.brightness, settings.keypoints.surf, mask=stack.mask, wrap=True)
    measurements, covariances, offsets, good = keypoints.measure(
        found.points, found.scales, stack, settings.keypoints, settings.noise
    )
    features = LidarFeatures(
        measurements[good],
        covariances[good],
        offsets[good],
        found.descriptors[good],
        found.laplacians[good],
        geometry.pixels_of(stack.places(found.points[good])),
    )
    return LidarFrame(scan.stamp_ns, features.in_order(), stack.brightness, RangeImage.of(stack))
