"""The live image and a stored one, compared at all horizontal shifts: the only measurement that there is."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from common.registration import (
    Described,
    GradientRepresentation,
    GradientSettings,
    NetworkRepresentation,
    Prepared,
    Registrar,
    Registration,
    Representation,
)
from common.registration.images import Image
from services.estimator.bearing.settings import BearingSettings


@dataclass(frozen=True, slots=True)
class BearingLive:
    """A frame: its image, ready to be compared, and the way since the last one by the wheels, metres and radians."""

    image: Image
    prepared: Prepared
    metres: float
    turn: float


@dataclass(frozen=True, slots=True)
class StoredImage:
    """A vertex's image, ready to be compared, and the actions (K, 4) on the way to it."""

    image: Prepared
    actions: NDArray[np.float32]


class Comparison:
    """Represents images and compares them; holds no state."""

    def __init__(self, settings: BearingSettings) -> None:
        """Raises ConfigurationError where the configured network cannot be used."""
        self._registrar = Registrar(_representation(settings), settings.max_shift)
        self._top = settings.skip_top
        self._tangent = float(np.tan(settings.field_of_view / 2.0))

    @property
    def name(self) -> str:
        """Of the representation: images of different ones cannot be compared."""
        return self._registrar.representation.name

    def prepare(self, image: Image | Described) -> Prepared:
        """An image, or its stored representation, ready to be compared.

        Raises:
            ImageError: the image cannot be represented.
        """
        if not isinstance(image, Described):
            image = image[round(self._top * image.shape[0]) :]
        return self._registrar.prepare(image)

    def compare(self, live: BearingLive, stored: StoredImage) -> Registration:
        """The similarity of a live and a stored image at all shifts.

        Raises:
            ImageError: they have not the same shape.
        """
        return self._registrar.register(live.prepared, stored.image)

    def radians_per_pixel(self, live: BearingLive) -> float:
        """Of heading, in the middle of the image, by the camera's rough field of view."""
        return 2.0 * self._tangent / live.prepared.described.width


def _representation(settings: BearingSettings) -> Representation:
    """A network where one is configured, else gradients at a working width of their own, the grid scaled with it."""
    if settings.model:
        return NetworkRepresentation(Path(settings.model).expanduser())
    full = GradientSettings()
    scale = settings.width / full.width
    return GradientRepresentation(
        GradientSettings(
            width=settings.width,
            row=max(round(full.row * scale), 1),
            smoothing=full.smoothing * scale,
            neighbourhood=2 * round(full.neighbourhood * scale / 2.0) + 1,
        )
    )
