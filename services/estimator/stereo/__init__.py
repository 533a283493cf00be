"""The stereo pipeline: VT&R3's five stages, one module each, as a library of arrays.

``preprocessing`` -> ``odometry`` -> ``mapping`` -> ``vertex_creation``, and ``localization`` against what was mapped.
Nothing here knows what an image stands for: the same pipeline runs on plain images and on any transform of them.
"""

from services.estimator.stereo.features import FeatureError, FeatureSet, StereoFrame
from services.estimator.stereo.localization import LocalizationResult, StereoLocalizer
from services.estimator.stereo.mapping import join, local_map, move
from services.estimator.stereo.odometry import StereoOdometry
from services.estimator.stereo.preprocessing import ImageError, preprocess
from services.estimator.stereo.settings import StereoSettings
from services.estimator.stereo.warm_up import warm_up
from services.estimator.vertex_creation import should_create

__all__ = [
    "FeatureError",
    "FeatureSet",
    "ImageError",
    "LocalizationResult",
    "StereoFrame",
    "StereoLocalizer",
    "StereoOdometry",
    "StereoSettings",
    "join",
    "local_map",
    "move",
    "preprocess",
    "should_create",
    "warm_up",
]
