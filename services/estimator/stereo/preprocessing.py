"""First stage, preprocessing: a stereo pair becomes features with landmarks. It knows no map and no motion."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from common.camera import StereoCamera
from services.estimator.stereo import brief, fast, refinement, stereo_matching
from services.estimator.stereo.features import FeatureSet, Image, StereoFrame
from services.estimator.stereo.rectification import Rectification, triangulate
from services.estimator.stereo.settings import StereoSettings

_SMOOTHING = 2.0
"""Standard deviation of the smoothing before BRIEF, pixels, as in its paper."""


class ImageError(ValueError):
    """An image is not what the camera delivers."""


def to_mono(image: NDArray[Any], camera: StereoCamera) -> Image:
    """Grey image (H, W) uint8 of a grey (H, W) or colour (H, W, 3), RGB, image of 8 bits.

    Raises:
        ImageError: the type or shape is another, or the size is not the camera's.
    """
    if image.dtype != np.uint8 or not (image.ndim == 2 or (image.ndim == 3 and image.shape[2] == 3)):
        raise ImageError(f"an image must be uint8 of shape (H, W) or (H, W, 3), not {image.dtype} {image.shape}")
    if image.shape[:2] != (camera.height, camera.width):
        raise ImageError(
            f"an image is {image.shape[1]}x{image.shape[0]}, its camera's are {camera.width}x{camera.height}"
        )
    grey = image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)
    # A view of a message is read-only, which to numba is another type, and a compilation in the middle of a drive.
    return np.require(grey, requirements=["C", "W"])


def preprocess(
    left: NDArray[Any],
    right: NDArray[Any],
    stamp_ns: int,
    camera: StereoCamera,
    settings: StereoSettings,
    rectification: Rectification | None = None,
) -> StereoFrame:
    """FAST on both images, correspondences by patch, BRIEF, landmarks with covariance.

    The images are rectified, (H, W) or (H, W, 3) RGB, uint8; ``rectification`` corrects what is known to remain of
    the cameras' misalignment. An image without texture gives a frame without features.

    Raises:
        ImageError: an image has another type or size than the camera's.
    """
    grey_left, grey_right = to_mono(left, camera), to_mono(right, camera)
    s = settings.preprocessing
    corners_left = fast.detect(grey_left, s.fast_threshold, cell=s.cell, limit=s.max_features)
    corners_right = fast.detect(grey_right, s.fast_threshold, cell=s.cell, limit=None)
    matched, seen_in_both = stereo_matching.correspond(grey_left, grey_right, corners_left, corners_right, s)
    if len(matched) == 0:
        return StereoFrame(stamp_ns, grey_left, FeatureSet.empty())
    places = np.ascontiguousarray(corners_left[matched])
    u, count = places[:, 0].astype(np.float32), len(places)
    smooth = np.asarray(cv2.GaussianBlur(grey_left, (0, 0), _SMOOTHING), dtype=np.uint8)
    seen = FeatureSet(
        measurements=np.stack([u, places[:, 1].astype(np.float32), u - seen_in_both.disparity], axis=-1),
        landmarks=np.zeros((count, 3), dtype=np.float32),
        covariances=np.zeros((count, 3, 3), dtype=np.float32),
        depths=np.zeros(count, dtype=np.float32),
        slants=seen_in_both.slant,
        disparity_sigmas=np.sqrt(seen_in_both.variance + settings.noise.disparity**2).astype(np.float32),
        descriptors=brief.describe(smooth, places),
        patches=refinement.extract(grey_left, places),
    )
    correction = rectification or Rectification.unknown(settings.noise)
    return StereoFrame(stamp_ns, grey_left, triangulate(seen, camera, settings.noise, correction, s.min_disparity))
