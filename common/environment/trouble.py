"""How much of a map repeats could not localize on, by hour of the day: what the fleet has learnt by driving.

Of R repeats at hours ``h_j`` (UTC, on the circle of a day), which drove ``m_j`` metres on a map and ``l_j`` of them
without localization, the trouble at hour h is

``(sum_j k(h - h_j) l_j) / (P + sum_j k(h - h_j) m_j)``,  ``k(d) = exp((cos(2 pi d / 24) - 1) / s^2)``

with a kernel some two hours wide, for light changes slowly, and with P metres that went well before anybody drove, so
that one bad metre says little. It lies in [0, 1], and is 0 where nobody had trouble.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

HOURS = 24
PRIOR_M = 20.0
"""P, metres."""
_WIDTH = 2.0 * math.pi * 2.0 / HOURS
"""s: two hours, as an angle."""


def kernel() -> Array:
    """(24, 24): what a repeat in each hour says about every hour."""
    hours = np.arange(HOURS)
    angle = 2.0 * math.pi * (hours[:, None] - hours) / HOURS
    weights: Array = np.exp((np.cos(angle) - 1.0) / _WIDTH**2)
    return weights


def shares(metres: Array, lost: Array) -> Array:
    """(..., 24) the trouble at each hour, of the metres driven and those not localized in each hour, (..., 24)."""
    weights = kernel()
    found: Array = np.clip((lost @ weights) / (PRIOR_M + metres @ weights), 0.0, 1.0)
    return found


def at_hour(shares_by_hour: NDArray[np.floating], hours: float) -> Array:
    """(N,) the trouble of N maps (N, 24) at a time, hours since the Unix epoch; between whole hours in proportion."""
    place = hours % HOURS
    lower = int(place) % HOURS
    part = place - int(place)
    found: Array = shares_by_hour[:, lower] * (1.0 - part) + shares_by_hour[:, (lower + 1) % HOURS] * part
    return found
