"""Motion distortion: a lidar turns for a tenth of a second, and moves meanwhile.

Each keypoint was seen from where the lidar was then. With a constant velocity over the turn that place is known, and
the keypoint is brought to the frame of the scan's stamp. The appearance-based lidar paper leaves this out; at 8 m/s a
turn is 0.8 m long. Scans that are already corrected, as KITTI's are, have no offsets and stay as they are.
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
