"""What a scan is reduced to: metric keypoints with their uncertainty and their looks, and landmarks of a map."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from services.estimator.lidar import model

Array = NDArray[np.float64]
Array32 = NDArray[np.float32]

DESCRIPTOR = 64
"""Values of a SURF descriptor."""
_UNIT = 127.0
"""What a stored descriptor's bytes are to its values, of which none exceeds 1."""


class FeatureError(ValueError):
    """Arrays do not form a set of landmarks."""


@dataclass(frozen=True, slots=True)
class LidarFeatures:
    """N metric keypoints of one scan, ordered by azimuth.

    Attributes:
        measurements: (N, 3) azimuth, elevation (radians) and range (metres), as measured.
        covariances: (N, 3, 3) of them.
        offsets: (N,) seconds from the scan's stamp.
        descriptors: (N, 64) float32, SURF, of length 1.
        laplacians: (N,) int8, sign of the Laplacian: bright blobs on dark ground match no dark ones.
        pixels: (N, 2) float32, column and row of the scan, or of the image stack where the scan has none.
    """

    measurements: Array
    covariances: Array
    offsets: Array
    descriptors: Array32
    laplacians: NDArray[np.int8]
    pixels: Array32

    def __len__(self) -> int:
        return len(self.measurements)

    @classmethod
    def empty(cls) -> LidarFeatures:
        """No features."""
        return cls(
            np.zeros((0, 3)),
            np.zeros((0, 3, 3)),
            np.zeros(0),
            np.zeros((0, DESCRIPTOR), dtype=np.float32),
            np.zeros(0, dtype=np.int8),
            np.zeros((0, 2), dtype=np.float32),
        )

    def select(self, index: NDArray[Any]) -> LidarFeatures:
        """The features of an index or of a mask."""
        return LidarFeatures(**{f.name: np.ascontiguousarray(getattr(self, f.name)[index]) for f in fields(self)})

    def in_order(self) -> LidarFeatures:
        """The features in the order of their azimuths."""
        return self.select(np.argsort(self.measurements[:, 0], kind="stable"))

    def landmarks(self) -> Landmarks:
        """What they saw, as points."""
        J = model.point_jacobians(self.measurements)
        return Landmarks(
            points=model.to_points(self.measurements).astype(np.float32),
            covariances=(J @ self.covariances @ J.transpose(0, 2, 1)).astype(np.float32),
            descriptors=np.rint(self.descriptors * _UNIT).astype(np.int8),
            laplacians=self.laplacians,
        )


@dataclass(frozen=True, slots=True)
class Landmarks:
    """N landmarks of one scan, or of a map joined from several.

    Attributes:
        points: (N, 3) float32, metres, in the lidar's frame at the stamp, or in the frame the map was moved to.
        covariances: (N, 3, 3) float32, square metres, of them in that frame.
        descriptors: (N, 64) int8, 127 times SURF's.
        laplacians: (N,) int8.
    """

    points: Array32
    covariances: Array32
    descriptors: NDArray[np.int8]
    laplacians: NDArray[np.int8]

    def __len__(self) -> int:
        return len(self.points)

    def select(self, index: NDArray[Any]) -> Landmarks:
        """The landmarks of an index or of a mask."""
        return Landmarks(**{f.name: np.ascontiguousarray(getattr(self, f.name)[index]) for f in fields(self)})

    @property
    def looks(self) -> Array32:
        """Their descriptors (N, 64) float32, of length 1."""
        values = self.descriptors.astype(np.float32)
        return np.asarray(values / np.maximum(np.linalg.norm(values, axis=1, keepdims=True), 1.0), dtype=np.float32)

    def to_arrays(self) -> dict[str, NDArray[Any]]:
        """Named arrays, to be stored or sent."""
        rows, columns = _UPPER
        return {
            "points": self.points,
            "covariances": np.ascontiguousarray(self.covariances[:, rows, columns]),
            "descriptors": self.descriptors,
            "laplacians": self.laplacians,
        }

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, NDArray[Any]]) -> Landmarks:
        """Inverse of :meth:`to_arrays`; other names are left aside.

        Raises:
            FeatureError: a name is missing, or a shape, type or value is not what it must be.
        """
        checked: dict[str, NDArray[Any]] = {}
        for name, (shape, dtype) in _LAYOUT.items():
            if name not in arrays:
                raise FeatureError(f"the landmarks have no array '{name}'")
            value = np.asarray(arrays[name])
            if value.dtype != dtype or value.ndim != len(shape) + 1 or value.shape[1:] != shape:
                raise FeatureError(
                    f"the landmarks' array '{name}' is {value.dtype}{value.shape}, not {dtype}(N, {shape})"
                )
            if not np.isfinite(value).all():
                raise FeatureError(f"the landmarks' array '{name}' is not finite")
            # Writable, as a message's view is not: to the compiled functions that is another type.
            checked[name] = np.require(value, requirements=["C", "W"])
        if len({len(value) for value in checked.values()}) > 1:
            raise FeatureError("the landmarks' arrays differ in length")
        rows, columns = _UPPER
        whole = np.zeros((len(checked["points"]), 3, 3), dtype=np.float32)
        whole[:, rows, columns] = whole[:, columns, rows] = checked["covariances"]
        return cls(checked["points"], whole, checked["descriptors"], checked["laplacians"])


_UPPER = np.triu_indices(3)
_LAYOUT: dict[str, tuple[tuple[int, ...], np.dtype[Any]]] = {
    "points": ((3,), np.dtype(np.float32)),
    "covariances": ((6,), np.dtype(np.float32)),
    "descriptors": ((DESCRIPTOR,), np.dtype(np.int8)),
    "laplacians": ((), np.dtype(np.int8)),
}
