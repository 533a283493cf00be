"""Where the base has been of late: a sensor that sweeps sees from all of these places."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from common.geometry import Array
from services.sensors.world.base import BaseState

_KEPT_S = 1.0


class Trail:
    """The base's path over the last second. One thread may add to it while another one asks."""

    def __init__(self, clock: float, state: BaseState) -> None:
        self._rows = _row(clock, state)

    def add(self, clock: float, state: BaseState) -> None:
        """Go on to a state at a time, seconds."""
        rows = self._rows
        row = _row(clock, state)
        # Angles go on without a jump, so that they can be interpolated.
        row[0, 3] += 2.0 * np.pi * np.round((rows[-1, 3] - row[0, 3]) / (2.0 * np.pi))
        first = max(0, int(np.searchsorted(rows[:, 0], clock - _KEPT_S)) - 1)
        self._rows = np.concatenate([rows[first:], row])

    def poses(self, times: ArrayLike) -> Array:
        """``[x, y, yaw]`` (K, 3) at times (K,), seconds.

        Before the trail begins the base stands at its beginning; after its end it drives on as it drove there.
        """
        rows, at = self._rows, np.asarray(times, dtype=np.float64)
        x, y, yaw = (np.interp(at, rows[:, 0], rows[:, k]) for k in (1, 2, 3))
        v, w = rows[-1, 4:]
        ahead = np.maximum(at - rows[-1, 0], 0.0)
        half = 0.5 * w * ahead
        # The chord of the arc: np.sinc(x) is sin(pi x) / (pi x).
        chord = v * ahead * np.sinc(half / np.pi)
        return np.stack([x + chord * np.cos(yaw + half), y + chord * np.sin(yaw + half), yaw + 2.0 * half], axis=-1)


def _row(clock: float, state: BaseState) -> Array:
    return np.array([[clock, state.x, state.y, state.yaw, *state.twist]])
