"""The periods that sun and week give to nearly everything that changes on Earth, with their first harmonics."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

DAY, WEEK, YEAR = 24.0, 168.0, 8765.8
PERIODS: Final = np.array([YEAR, YEAR / 2, WEEK, WEEK / 2, WEEK / 3, DAY, DAY / 2, DAY / 3, DAY / 4])
"""Hours."""
FREQUENCIES: Final = 1.0 / PERIODS
"""1/hour."""

_ODDS = 20.0
"""How many times likelier than any other frequency one of these is, before anything was measured."""
_NEAR = 0.25
"""Largest distance, in one over the span, of a frequency that gets the odds: a grid's step, about."""


def credit(frequencies: Array, resolution: float) -> Array:
    """(M,) logarithms of the odds of frequencies, 1/hour; ``resolution`` is one over the span."""
    near = np.abs(frequencies[:, None] - FREQUENCIES).min(axis=1) < _NEAR * resolution
    return np.where(near, math.log(_ODDS), 0.0)
