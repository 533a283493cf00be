"""From an image to its features: the steps in their order, and the check of what comes in."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from services.estimator.surf import descriptor
from services.estimator.surf.descriptor import describe
from services.estimator.surf.detector import detect
from services.estimator.surf.features import SurfError, SurfFeatures
from services.estimator.surf.integral import integral
from services.estimator.surf.octaves import largest_scale, octaves_of, reach_of
from services.estimator.surf.orientation import orient
from services.estimator.surf.selection import select
from services.estimator.surf.settings import SurfSettings


def detect_and_describe(
    image: NDArray[np.uint8],
    settings: SurfSettings | None = None,
    mask: NDArray[Any] | None = None,
    *,
    wrap: bool = False,
) -> SurfFeatures:
    """Features of a grey image (H, W).

    No feature has its centre where the mask (H, W) is zero. With ``wrap`` the left and the right edge are neighbours,
    as in a panorama of 360 degrees: features are found and described across them.

    Raises:
        SurfError: the image or the mask has another shape or type, or the device of the settings is not there.
    """
    used = settings or SurfSettings()
    grey, allowed = _checked(image, mask)
    height, width = grey.shape
    octaves = octaves_of(height, width, used.octaves, used.layers)
    if not octaves:
        return SurfFeatures.empty()
    pad = reach_of(octaves)
    # A panorama goes on beyond what a descriptor sees; elsewhere repeated pixels are extrapolated.
    pad_x = max(pad, math.ceil(descriptor.REACH * largest_scale(octaves))) if wrap else pad
    sums = integral(grey, pad_x, pad, wrap=wrap)
    blobs = select(detect(sums, grey.shape, octaves, used.hessian_threshold), grey.shape, used, allowed, wrap=wrap)
    angles = np.zeros(len(blobs.points)) if used.upright else orient(sums, blobs.points, blobs.scales)
    return SurfFeatures(
        blobs.points.astype(np.float32),
        blobs.scales.astype(np.float32),
        angles.astype(np.float32),
        blobs.laplacians,
        blobs.responses.astype(np.float32),
        describe(sums, blobs.points, blobs.scales, angles),
    )


def _checked(image: NDArray[np.uint8], mask: NDArray[Any] | None) -> tuple[NDArray[np.uint8], NDArray[np.uint8] | None]:
    """Both as contiguous arrays of bytes."""
    grey = np.asarray(image)
    if grey.ndim != 2 or grey.dtype != np.uint8:
        raise SurfError(f"the image must be grey, (H, W) uint8, not {grey.dtype}{grey.shape}")
    if mask is None:
        return np.ascontiguousarray(grey), None
    allowed = np.asarray(mask)
    if allowed.shape != grey.shape or allowed.dtype not in {np.dtype(np.uint8), np.dtype(np.bool_)}:
        raise SurfError(f"the mask must be uint8{grey.shape}, as the image, not {allowed.dtype}{allowed.shape}")
    return np.ascontiguousarray(grey), np.ascontiguousarray(allowed).view(np.uint8)
