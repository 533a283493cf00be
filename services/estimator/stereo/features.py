"""What a stereo pair is reduced to: landmarks with their uncertainty and their looks."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from services.estimator.stereo.brief import BYTES
from services.estimator.stereo.refinement import PATCH

Array32 = NDArray[np.float32]
Image = NDArray[np.uint8]


class FeatureError(ValueError):
    """Arrays do not form a set of features."""


@dataclass(frozen=True, slots=True)
class FeatureSet:
    """N features of one stereo pair, or of a map joined from several.

    Attributes:
        measurements: (N, 3) float32 ``[u_left, v, u_right]``, pixels of the pair in which each was seen.
        landmarks: (N, 3) float32, metres, in the optical frame of the pair, or in the frame the map was moved to.
        covariances: (N, 3, 3) float32, square metres, of the landmarks in that frame.
        depths: (N,) float32, metres, from which each patch was seen.
        slants: (N,) float32, change of the disparity from one row of the patch to the next: a surface that leans.
        disparity_sigmas: (N,) float32, pixels, standard deviation of the disparity, by the patch's fit.
        descriptors: (N, 32) uint8, BRIEF-256.
        patches: (N, 13, 13) uint8, the pixels around each feature in the left image.
    """

    measurements: Array32
    landmarks: Array32
    covariances: Array32
    depths: Array32
    slants: Array32
    disparity_sigmas: Array32
    descriptors: NDArray[np.uint8]
    patches: NDArray[np.uint8]

    def __len__(self) -> int:
        return len(self.landmarks)

    @classmethod
    def empty(cls) -> FeatureSet:
        """No features."""
        return cls(**{name: np.zeros((0, *shape), dtype=dtype) for name, (shape, dtype) in _LAYOUT.items()})

    def select(self, index: NDArray[Any]) -> FeatureSet:
        """The features of an index or of a mask."""
        return FeatureSet(**{f.name: np.ascontiguousarray(getattr(self, f.name)[index]) for f in fields(self)})

    def to_arrays(self) -> dict[str, NDArray[Any]]:
        """Named arrays, to be stored or sent."""
        return {f.name: getattr(self, f.name) for f in fields(self)}

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, NDArray[Any]]) -> FeatureSet:
        """Inverse of :meth:`to_arrays`; other names are left aside.

        Raises:
            FeatureError: a name is missing, or a shape, type or value is not what it must be.
        """
        checked: dict[str, NDArray[Any]] = {}
        for name, (shape, dtype) in _LAYOUT.items():
            if name not in arrays:
                raise FeatureError(f"the features have no array '{name}'")
            value = np.asarray(arrays[name])
            if value.dtype != dtype or value.shape[1:] != shape or value.ndim != len(shape) + 1:
                raise FeatureError(
                    f"the features' array '{name}' is {value.dtype}{value.shape}, not {dtype}(N, {shape})"
                )
            if not np.isfinite(value).all():
                raise FeatureError(f"the features' array '{name}' is not finite")
            # Writable, as a message's view is not: to the compiled functions that is another type.
            checked[name] = np.require(value, requirements=["C", "W"])
        if len({len(value) for value in checked.values()}) > 1:
            raise FeatureError("the features' arrays differ in length")
        return cls(**checked)


_LAYOUT: dict[str, tuple[tuple[int, ...], np.dtype[Any]]] = {
    "measurements": ((3,), np.dtype(np.float32)),
    "landmarks": ((3,), np.dtype(np.float32)),
    "covariances": ((3, 3), np.dtype(np.float32)),
    "depths": ((), np.dtype(np.float32)),
    "slants": ((), np.dtype(np.float32)),
    "disparity_sigmas": ((), np.dtype(np.float32)),
    "descriptors": ((BYTES,), np.dtype(np.uint8)),
    "patches": ((PATCH, PATCH), np.dtype(np.uint8)),
}


@dataclass(frozen=True, slots=True)
class StereoFrame:
    """A preprocessed pair.

    Attributes:
        stamp_ns: when it was taken, nanoseconds since the Unix epoch.
        left: (H, W) uint8, the image that is searched and refined in.
        features: what was found in it, in reading order.
    """

    stamp_ns: int
    left: Image
    features: FeatureSet
