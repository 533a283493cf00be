"""How fast to drive where: curves, the end of a section, and how well the robot knows where it is."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from services.tracker.limits import LimitError, Limits

Array = NDArray[np.float64]


_PLANNED = 0.6
"""Share of the deceleration that the profile uses; the rest is left to the controller, for a base that brakes late."""


@dataclass(frozen=True, slots=True)
class CautionSettings:
    """When to slow down for poor localisation: from full speed at ``*_free`` to ``slowest`` of it at ``*_worst``.

    Safety, not the tracker, decides when to stop.

    Attributes:
        metres_free, metres_worst: metres driven since the last localization.
        seconds_free, seconds_worst: seconds since the last localization.
        sigma_free, sigma_worst: standard deviation of the position, metres.
        slowest: least share of the speed.
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
    (xx, xy), (_, yy) = np.asarray(covariance, dtype=np.float64)[:2, :2].tolist()
    if not all(map(math.isfinite, (xx, xy, yy, metres, seconds))):
        return settings.slowest
    largest = 0.5 * (xx + yy) + math.hypot(0.5 * (xx - yy), xy)
    sigma = math.sqrt(max(largest, 0.0))
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


def checked_limits(limits: ArrayLike, count: int) -> Array:
    """The limits (N,) of a route's stretches in m/s, infinite where there is none; all so for an empty list.

    Raises:
        LimitError: there is not one for each of the ``count`` vertices, or one is not positive.
    """
    array = np.asarray(limits, dtype=np.float64)
    if array.size == 0:
        return np.full(count, np.inf)
    if array.shape != (count,):
        raise LimitError(f"A route of {count} vertices needs as many speed limits or none, not {array.size}.")
    if not (array > 0.0).all():
        raise LimitError("A speed limit of the route is not positive: a robot cannot follow a route at rest.")
    return array


def limit_between(s: Array, vertex_s: Array, limits: Array) -> Array:
    """The limit (M-1,) between samples at ascending arclength ``s`` (M,): the least of the stretches that lie there.

    ``limits`` (N,) hold from their vertices at ``vertex_s`` (N,), in order, to the next ones.
    """
    first = np.maximum(np.searchsorted(vertex_s, s[:-1], side="right") - 1, 0)
    beyond = np.maximum(np.searchsorted(vertex_s, s[1:], side="left"), first + 1)
    # The even results are those of [first, beyond); the infinity at the end lets `beyond` be the number of vertices.
    least = np.minimum.reduceat(np.append(limits, np.inf), np.stack([first, beyond], axis=1).ravel())
    return least[::2]


def braking_bound(at: Array, speed: Array, deceleration: float) -> Array:
    """The speeds (M,) at places ``at`` (M,) from which every later one of ``speed`` (M,) is reached by braking.

    `v^2 = v0^2 + 2 a s`, hence the least of `speed_j^2 + 2 a (s_j - s_i)` over all later places.
    """
    reach = 2.0 * deceleration * at
    squared = np.minimum.accumulate((speed**2 + reach)[::-1])[::-1] - reach
    return np.asarray(np.sqrt(np.maximum(squared, 0.0)))


def planned_deceleration(limits: Limits) -> float:
    """The deceleration to plan with; the rest of it is left to the controller, for a base that brakes late."""
    return _PLANNED * limits.deceleration


def speed_profile(s: Array, curvature: Array, limits: Limits, between: Array | None = None) -> Array:
    """The highest speed (M,) along samples at arclength ``s`` (M,), at rest at the last one.

    Curves are bounded by lateral acceleration and turn rate, and the stretches from a sample to the next by their
    limit ``between`` (M-1,); a pass backwards then makes every slow place reachable by its share of the deceleration,
    and a pass forwards every fast one by the acceleration. The first sample is left free, as the robot may enter at
    speed.
    """
    bend = np.maximum(np.abs(curvature), 1e-9)
    speed = np.minimum(np.sqrt(limits.lateral_acceleration / bend), limits.turn_rate / bend)
    speed = np.minimum(speed, limits.speed)
    if between is not None:
        speed[:-1] = np.minimum(speed[:-1], between)
        speed[1:] = np.minimum(speed[1:], between)
    speed[-1] = 0.0
    speed = braking_bound(s, speed, planned_deceleration(limits))
    return braking_bound(-s[::-1], speed[::-1], limits.acceleration)[::-1]
