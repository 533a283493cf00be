"""A sensor that repeats its last frame, as drivers do that hang: what it shows stands still while the wheels turn.

Its frames would agree perfectly that the vehicle stands, and lead it off its path. They are taken for frames that show
nothing, like those of a covered lens, until another one comes. Two frames of a sensor that works are never the same to
the bit, for each has noise of its own; where they are, as a simulator's without noise, a vehicle at rest is believed.
A picture all of one value, of a covered lens or an open sky, is no repeat.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from services.estimator.sensors.sensor import SensorFrame

Frame = TypeVar("Frame", bound=SensorFrame)

REASON = "the sensor repeats its last frame"

_EVERY = 16
"""Of so many columns one is compared: all beams of a lidar, for the upper ones may see nothing but sky."""

_TURNS = 0.02
"""Wheels that turn: m/s, or rad/s."""


class Repeats:
    """Asked with each frame, in order; ``pictures`` are the fields that hold what the sensor sees."""

    def __init__(self, pictures: Sequence[str]) -> None:
        self._pictures = pictures
        self._last: list[NDArray[np.generic]] = []
        self._frozen = False

    def repeats(self, frame: SensorFrame, twist: tuple[float, float] | None) -> bool:
        """Whether a frame is one that the sensor repeats.

        ``twist`` is what the wheels report (m/s, rad/s), None where they do not.
        """
        parts = [getattr(frame, name)[:, ::_EVERY] for name in self._pictures]
        same = any(
            np.array_equal(now, before) and np.ptp(now) > 0 for now, before in zip(parts, self._last, strict=False)
        )
        turns = twist is not None and max(map(abs, twist)) > _TURNS
        self._frozen = same and (turns or self._frozen)
        if not same:
            self._last = [part.copy() for part in parts]
        return self._frozen


def without_sight(frame: Frame, pictures: Sequence[str]) -> Frame:
    """A frame of the same sensor and time that shows nothing."""
    return frame.model_copy(update={name: np.zeros_like(getattr(frame, name)) for name in pictures})
