"""Which descriptors of a frame stand for the place that it shows."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from services.estimator.stereo.features import FeatureSet
from services.estimator.stereo.mapping import local_map
from services.estimator.stereo.settings import MappingSettings

STORED = 200
"""Descriptors of a stream that a vertex keeps to be recognised by: 6.4 kB."""

Appearance = Mapping[str, NDArray[np.uint8]]
"""Descriptors (N, 32) by the name of the stream whose images they describe."""


def appearance_of(streams: Mapping[str, FeatureSet], limit: int = STORED) -> dict[str, NDArray[np.uint8]]:
    """At most ``limit`` descriptors (N, 32) of each stream's features: spread over the image, the nearest first.

    Near landmarks are the place's own; what is far looks the same from every vertex around.
    """
    settings = MappingSettings(max_landmarks=limit)
    return {name: local_map(features, settings).descriptors for name, features in streams.items()}
