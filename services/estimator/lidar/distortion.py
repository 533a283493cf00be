"""Motion distortion: a lidar turns for a tenth of a second, and moves meanwhile.

Each keypoint was seen from where the lidar was then. With a constant velocity over the turn that place is known, and
the keypoint is brought to the frame of the scan's stamp. The appearance-based lidar paper leaves this out; at 8 m/s a
turn is 0.8 m long. Scans that are already corrected, as KITTI's are, have no offsets and stay as they are.

The velocity must not be read off the stamps' poses: a stamp at the end of a turn lies half a turn after what was seen
on average, so that an error of the velocity moves that pose, which the next velocity is told by, and so on without
end. The poses in the middle of the turns do not depend on it.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from common import geometry
from common.geometry import Array
from services.estimator.lidar import model
from services.estimator.lidar.features import LidarFeatures


def compensate(features: LidarFeatures, twist: Array) -> LidarFeatures:
    """The features as seen at the stamp by a lidar that moves with ``twist`` (6,), m/s and rad/s."""
    if not features.offsets.any():
        return features
    T_stamp_then = geometry.exp(features.offsets[:, None] * twist)
    points = (T_stamp_then[:, :3, :3] @ model.to_points(features.measurements)[..., None])[..., 0]
    measurements = model.to_measurements(points + T_stamp_then[:, :3, 3])
    # Covariances are along the beam and across it: they turn with the beam, but for what is far below their size.
    return replace(features, measurements=measurements, offsets=np.zeros_like(features.offsets)).in_order()


def T_stamp_middle(features: LidarFeatures, twist: Array) -> Array:
    """Where (4, 4) the lidar was, on average, when it saw the features that are as measured."""
    return geometry.exp(np.mean(features.offsets) * twist) if len(features) else np.eye(4)


def uncertainty(features: LidarFeatures, pose: Array, change: Array, seconds: float) -> Array:
    """Covariance (6, 6) that an error of the twist gives to the pose at the stamp of features that are as measured.

    ``pose`` (6, 6) is that of the poses ``seconds`` apart that tell the twist, ``change`` (6,) the twist's from the
    last turn to this one: the velocity is not constant either.
    """
    if len(features) == 0:
        return np.zeros((6, 6))
    return float(np.mean(features.offsets)) ** 2 * (2.0 * pose / seconds**2 + np.diag(change**2))
