"""Wheel odometry as a prior of the motion between two frames, and as dead reckoning where the images tell nothing."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from common import geometry
from common.geometry import Uncertain


@dataclass(frozen=True, slots=True)
class WheelSettings:
    """How far wheels are believed: standard deviations a second of driving.

    Attributes:
        slip: part of the speed that the ground may not get, or give in addition.
        turn_slip: likewise of the turn rate.
        speed: of a vehicle whose wheels stand, m/s, along each axis.
        turn_rate: likewise about the vertical axis, rad/s.
        tilt_rate: of roll and pitch, which wheels do not tell, rad/s.
        longest: seconds between frames beyond which two readings say nothing of what lay between them.
    """

    slip: float = 0.1
    turn_slip: float = 0.15
    speed: float = 0.03
    turn_rate: float = 0.05
    tilt_rate: float = 0.4
    longest: float = 0.5


class WheelMotion:
    """Motion from one frame to the next by what the wheels reported at both."""

    def __init__(self, settings: WheelSettings) -> None:
        self._settings = settings
        self._last: tuple[float, float] | None = None

    def step(self, twist: tuple[float, float] | None, seconds: float) -> Uncertain | None:
        """``T_last_live`` of the vehicle over ``seconds``, None where the wheels do not tell.

        ``twist`` is the newest reading (m/s, rad/s), None where it is missing or stale.
        """
        last, self._last = self._last, twist
        if twist is None or last is None or not 0.0 < seconds <= self._settings.longest:
            return None
        v, w = (np.asarray(last) + np.asarray(twist)) / 2.0
        s = self._settings
        rates = [
            s.slip * abs(v) + s.speed,
            s.slip * abs(v) + s.speed,
            s.slip * abs(v) + s.speed,
            s.tilt_rate,
            s.tilt_rate,
            s.turn_slip * abs(w) + s.turn_rate,
        ]
        T_last_live = geometry.exp(np.array([v, 0.0, 0.0, 0.0, 0.0, w]) * seconds)
        return Uncertain(T_last_live, np.diag((np.array(rates) * seconds) ** 2))
