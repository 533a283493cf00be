"""The appearance-based lidar pipeline: VT&R3's five stages, one module each, as a library of arrays.

``preprocessing`` (``beams``, ``images``, ``keypoints``) -> ``odometry`` (``matching``, ``ransac``, ``solver``) ->
``mapping`` -> vertex creation, which all sensors share, and ``localization`` against what was mapped.
"""

from services.estimator.lidar.beams import ScanError
from services.estimator.lidar.features import FeatureError, Landmarks, LidarFeatures
from services.estimator.lidar.localization import LidarLocalizer, LocalizationResult
from services.estimator.lidar.mapping import LidarSubmap, local_map
from services.estimator.lidar.odometry import LidarOdometry
from services.estimator.lidar.preprocessing import LidarFrame, preprocess
from services.estimator.lidar.settings import LidarSettings
from services.estimator.lidar.warm_up import warm_up

__all__ = [
    "FeatureError",
    "Landmarks",
    "LidarFeatures",
    "LidarFrame",
    "LidarLocalizer",
    "LidarOdometry",
    "LidarSettings",
    "LidarSubmap",
    "LocalizationResult",
    "ScanError",
    "local_map",
    "preprocess",
    "warm_up",
]
