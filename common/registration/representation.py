"""What an image becomes for registration: a dense representation, R(I) of the thesis's equation 3.4."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Protocol, Self

import numpy as np
from numpy.typing import NDArray

from common.errors import ImageError
from common.registration.images import Image

Values = NDArray[np.float32]

_STEPS = 127
"""Largest whole number of a stored value."""
_NAME_LENGTH = 64


class Representation(Protocol):
    """A way to represent images, by hand or by a network."""

    @property
    def name(self) -> str:
        """What made a stored representation; only those of one name can be compared."""

    def describe(self, image: Image) -> Described:
        """The representation of an image (H, W) or (H, W, 3) RGB.

        Raises:
            ImageError: the image cannot be represented.
        """


@dataclass(frozen=True, slots=True)
class Described:
    """An image's representation, and what has to be known of the image to compare it with another.

    Attributes:
        values: (c, h, w), channels over a grid of cells; the cells of a row share the image's width evenly.
        width, height: of the image, pixels.
        cell_height: height of a cell, in widths of the image.
        name: of the :class:`Representation`.
    """

    values: Values
    width: int
    height: int
    cell_height: float
    name: str

    def to_arrays(self) -> dict[str, NDArray[Any]]:
        """The representation as plain arrays, a byte a value, for a map's keyframe.

        Rounding to a byte moves a shift by hundredths of a pixel.
        """
        scale = float(np.abs(self.values).max()) / _STEPS or 1.0
        return {
            "values": np.rint(self.values / scale).astype(np.int8),
            "geometry": np.array([self.width, self.height, self.cell_height, scale]),
            "name": np.frombuffer(self.name.encode()[:_NAME_LENGTH], dtype=np.uint8),
        }

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, NDArray[Any]]) -> Self:
        """What :meth:`to_arrays` wrote.

        Raises:
            ImageError: the arrays are no stored representation.
        """
        try:
            values, geometry, name = arrays["values"], arrays["geometry"], arrays["name"]
            width, height, cell_height, scale = (float(value) for value in geometry)
            text = name.tobytes().decode()
        except (KeyError, TypeError, ValueError) as error:
            raise ImageError(f"these arrays hold no representation of an image ({error})") from error
        if values.ndim != 3 or values.size == 0 or not np.isfinite(geometry).all() or min(width, height, scale) <= 0:
            raise ImageError(f"these arrays of shape {values.shape} hold no representation of an image")
        return cls(values.astype(np.float32) * np.float32(scale), int(width), int(height), cell_height, text)
