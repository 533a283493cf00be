"""How fast to drive where: curves, the end of a section, and how well the robot knows where it is."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

if TYPE_CHECKING:
    from services.tracker.limits import Limits

Array = NDArray[np.float64]


_PLANNED = 0.6
"""Share of the deceleration that the profile uses; the rest is left to the controller, for a base that brakes late."""


@dataclass(frozen=True, slots=True)
class CautionSettings:
    """When to slow down for poor localisation: from full speed at ``*_free`` to ``slowest`` of it at ``*_worst``.

    Metres driven and seconds since the last success, and the standard deviation of the position in metres.
    Safety, not the tracker, decides when to stop.
    """

    metres_free: float = 2.0
    metres_worst: float = 8.0
    seconds_free: float = 2.0
    seconds_worst: float = 8.0
    sigma_free: float = 0.10
    sigma_worst: float = 0.40
    slowest: float = 0.3


def caution(metres: float, seconds: float, covariance: ArrayLike, settings: CautionSettings) -> float:
    """Share of the speed, in [slowest, 1], that the localisation justifies; the slowest for what is not finite.

    ``covariance`` (6, 6) is that of ``T_trunk_robot``, translation first.
    """
    in_plane = np.asarray(covariance, dtype=np.float64)[:2, :2]
    if not (np.isfinite(in_plane).all() and np.isfinite([metres, seconds]).all()):
        return settings.slowest
    sigma = float(np.sqrt(max(np.linalg.eigvalsh(in_plane)[-1], 0.0)))
    worst = max(
        _share(metres, settings.metres_free, settings.metres_worst),
        _share(seconds, settings.seconds_free, settings.seconds_worst),
        _share(sigma, settings.sigma_free, settings.sigma_worst),
    )
    return 1.0 - worst * (1.0 - settings.slowest)


def _share(value: float, free: float, worst: float) -> float:
    """How far a value is on the way from ``free`` to ``worst``, in [0, 1]."""
    if worst <= free:
        return float(value > free)
    return min(max((value - free) / (worst - free), 0.0), 1.0)


def speed_profile(s: Array, curvature: Array, limits: Limits) -> Array:
    """The highest speed (M,) along samples at arclength ``s`` (M,), at rest at the last one.

    Curves are bounded by lateral acceleration and turn rate; a pass backwards then makes every slow place reachable
    by its share of the deceleration, and a pass forwards every fast one by the acceleration (`v^2 = v0^2 + 2 a s`).
    The first sample is left free, as the robot may enter at speed.
    """
    bend = np.maximum(np.abs(curvature), 1e-9)
    squared = np.minimum(limits.lateral_acceleration / bend, (limits.turn_rate / bend) ** 2)
    squared = np.minimum(squared, limits.speed**2)
    squared[-1] = 0.0
    step = np.diff(s)
    for i in range(len(step) - 1, -1, -1):
        squared[i] = min(squared[i], squared[i + 1] + 2.0 * _PLANNED * limits.deceleration * step[i])
    for i in range(len(step)):
        squared[i + 1] = min(squared[i + 1], squared[i] + 2.0 * limits.acceleration * step[i])
    return np.sqrt(squared)
