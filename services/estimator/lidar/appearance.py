"""What a scan looks like, to be recognised among thousands of vertices: SURF descriptors as 256 bits each.

Bit k of a descriptor is the side of a random hyperplane on which it lies; two descriptors at an angle differ in
``angle / pi`` of the bits, on average (M. Charikar, *Similarity estimation techniques from rounding algorithms*, STOC
2002, section 3). So the index of the places knows no difference between these and BRIEF's.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from services.estimator.lidar.features import DESCRIPTOR, Landmarks
from services.estimator.lidar.mapping import local_map
from services.estimator.lidar.settings import MappingSettings

STREAM = "lidar"
"""Name under which a vertex keeps its descriptors."""

STORED = 200
"""Descriptors that a vertex keeps to be recognised by: 6.4 kB."""

_BITS = 256
_NORMALS = np.random.default_rng(1).standard_normal((DESCRIPTOR, _BITS)).astype(np.float32)
"""Of the hyperplanes; every robot of a fleet has the same ones."""


def as_bits(descriptors: NDArray[np.float32]) -> NDArray[np.uint8]:
    """Descriptors (N, 64) as (N, 32) bytes of 8 bits each."""
    return np.packbits(descriptors @ _NORMALS > 0.0, axis=1)


def appearance_of(landmarks: Landmarks, limit: int = STORED) -> dict[str, NDArray[np.uint8]]:
    """At most ``limit`` descriptors (N, 32) of a scan, spread all around, of its surest landmarks."""
    return {STREAM: as_bits(local_map(landmarks, MappingSettings(max_landmarks=limit)).looks)}
