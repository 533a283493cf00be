"""From an image with its margins to features, at a device."""

from __future__ import annotations

import numpy as np

from services.estimator.surf.arrays.description import describe
from services.estimator.surf.arrays.detection import detect
from services.estimator.surf.arrays.device import Device
from services.estimator.surf.arrays.sums import integral
from services.estimator.surf.features import SurfFeatures
from services.estimator.surf.frame import Frame
from services.estimator.surf.selection import select


def extract(frame: Frame, device: Device) -> SurfFeatures:
    """The features of an image, by whole arrays: those that the compiled loops find."""
    sums = integral(device, frame.wide, frame.pad_x, frame.pad_y)
    found = detect(sums, frame.shape, frame.octaves, frame.settings.hessian_threshold)
    blobs = select(found, frame.shape, frame.settings, frame.mask, wrap=frame.wrap)
    angles, descriptors = describe(sums, blobs.points, blobs.scales, upright=frame.settings.upright)
    return SurfFeatures(
        blobs.points.astype(np.float32),
        blobs.scales.astype(np.float32),
        angles,
        blobs.laplacians,
        blobs.responses.astype(np.float32),
        descriptors,
    )
