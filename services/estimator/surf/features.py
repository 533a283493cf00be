"""What an image is reduced to: blobs with a place, a size, an orientation and a descriptor."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

VALUES = 64
"""Length of a descriptor."""


class SurfError(ValueError):
    """An image, a mask or a set of candidates is not what it must be, or the device is not there."""


@dataclass(frozen=True, slots=True)
class SurfFeatures:
    """N features of one image, the strongest first.

    Attributes:
        points: (N, 2) float32 ``[x, y]``, pixels; the centre of the image's first pixel is the origin.
        scales: (N,) float32, pixels: the paper's sigma, 1.2 for a filter of 9 pixels. A Gaussian spot's own standard
            deviation is 1.4 times as large.
        angles: (N,) float32, radians from the x axis towards the y axis, so clockwise as seen; 0 where upright.
        laplacians: (N,) int8, the sign of the Laplacian: -1 for a bright blob, +1 for a dark one.
        responses: (N,) float32, determinant of the Hessian, normalised by the filter's area and weighted by a power of
            the scale, square grey levels.
        descriptors: (N, 64) float32 of unit length.
    """

    points: NDArray[np.float32]
    scales: NDArray[np.float32]
    angles: NDArray[np.float32]
    laplacians: NDArray[np.int8]
    responses: NDArray[np.float32]
    descriptors: NDArray[np.float32]

    def __len__(self) -> int:
        return len(self.points)

    @classmethod
    def empty(cls) -> SurfFeatures:
        """No features."""
        values = np.zeros(0, np.float32)
        points, descriptors = np.zeros((0, 2), np.float32), np.zeros((0, VALUES), np.float32)
        return cls(points, values, values, np.zeros(0, np.int8), values, descriptors)

    def select(self, rows: NDArray[Any]) -> SurfFeatures:
        """The features of an index or of a mask."""
        return SurfFeatures(*(np.ascontiguousarray(getattr(self, f.name)[rows]) for f in fields(self)))
