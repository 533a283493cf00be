"""From an image to its features: the steps in their order."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from services.estimator.surf import arrays
from services.estimator.surf.descriptor import describe
from services.estimator.surf.detector import detect
from services.estimator.surf.features import SurfFeatures
from services.estimator.surf.frame import Frame, prepare
from services.estimator.surf.integral import integral
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
    device = arrays.find_gpu() if used.device == "gpu" else None
    frame = prepare(image, used, mask, wrap=wrap)
    if not frame.octaves:
        return SurfFeatures.empty()
    return extract(frame) if device is None else arrays.extract(frame, device)


def extract(frame: Frame) -> SurfFeatures:
    """The features of an image, by the compiled loops."""
    sums = integral(frame.wide, frame.pad_x, frame.pad_y)
    found = detect(sums, frame.shape, frame.octaves, frame.settings.hessian_threshold)
    blobs = select(found, frame.shape, frame.settings, frame.mask, wrap=frame.wrap)
    angles = np.zeros(len(blobs.points)) if frame.settings.upright else orient(sums, blobs.points, blobs.scales)
    return SurfFeatures(
        blobs.points.astype(np.float32),
        blobs.scales.astype(np.float32),
        angles.astype(np.float32),
        blobs.laplacians,
        blobs.responses.astype(np.float32),
        describe(sums, blobs.points, blobs.scales, angles),
    )
