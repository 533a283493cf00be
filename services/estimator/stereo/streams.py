"""The streams of a stereo camera: the images as they are and, of colour images, the illumination-invariant ones.

Figure 4 of C. McManus et al., *Shady dealings*, ICRA 2014: two localisers in parallel, both guided by the odometry of
the plain stream.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from common.camera import StereoCamera
from services.estimator.stereo.features import StereoFrame
from services.estimator.stereo.invariance import InvariantTransform
from services.estimator.stereo.preprocessing import preprocess
from services.estimator.stereo.rectification import Rectification
from services.estimator.stereo.settings import StereoSettings

PLAIN = "plain"
"""Name of the stream that works on the images as they are, in grey."""

INVARIANT = "invariant"
"""Name of the stream that works on illumination-invariant images."""

Streams = dict[str, StereoFrame]
"""A preprocessed pair by the name of the stream; the plain one is always there."""


def is_colour(image: NDArray[Any]) -> bool:
    """Whether an image has the three channels that the invariant stream needs."""
    return image.ndim == 3


class InvariantStream:
    """Preprocessing of the invariant stream; it keeps no state between calls."""

    def __init__(self, camera: StereoCamera, settings: StereoSettings) -> None:
        """Raises ValueError where the camera's wavelengths are in no order."""
        self._camera = camera
        self._settings = settings
        self.transform = InvariantTransform(camera, settings.invariance)

    def preprocess(
        self, left: NDArray[np.uint8], right: NDArray[np.uint8], stamp: int, rectification: Rectification
    ) -> StereoFrame:
        """Features of the invariant images of a pair of colour images (H, W, 3)."""
        images = self.transform(left), self.transform(right)
        return preprocess(*images, stamp, self._camera, self._settings, rectification)
