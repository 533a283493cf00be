"""From one command to the next: whatever is wanted, the change is one that the vehicle can make in a cycle."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from services.tracker.limits import Limits


def brake(v: float, w: float, seconds: float, limits: Limits) -> tuple[float, float]:
    """A command one cycle nearer to rest, on the same arc: ``v / w`` stays, and no limit on acceleration is exceeded.

    ``v`` of either sign. Turning on the spot is slowed by the limit on the turn's acceleration.
    """
    keep_v = 1.0 - limits.deceleration * seconds / max(abs(v), 1e-9)
    keep_w = 1.0 - limits.turn_acceleration * seconds / max(abs(w), 1e-9)
    keep = max(keep_v, keep_w, 0.0)
    return v * keep, w * keep


def braking_rate(limits: Limits) -> float:
    """The deceleration (m/s^2) that the turn rate can follow at the tightest curve.

    From any command within the limits the speed can fall by this rate, whatever the turn rate is to become.
    """
    if limits.curvature is None:
        return limits.deceleration
    return min(limits.deceleration, limits.turn_acceleration / limits.curvature)


def within(v: float, w: float, limits: Limits) -> tuple[float, float]:
    """The command brought within the limits on speed, turn rate and curvature; rest for what is no number."""
    if not (math.isfinite(v) and math.isfinite(w)):
        return 0.0, 0.0
    v = min(max(v, -limits.speed), limits.speed)
    bound = turn_bound(v, limits)
    return v, min(max(w, -bound), bound)


def turn_bound(v: float, limits: Limits) -> float:
    """The highest turn rate at a speed, rad/s."""
    return limits.turn_rate if limits.curvature is None else min(limits.turn_rate, limits.curvature * abs(v))


def approach(
    now: tuple[float, float], wanted: tuple[float, float], seconds: float, limits: Limits
) -> tuple[float, float]:
    """The command nearest to the wanted one that the vehicle can have ``seconds`` after ``now``; neither needs be kept.

    All limits hold, whatever is wanted. A speed of the other sign is gone to by way of rest; rest is wanted where the
    wanted command is no number.
    """
    v0, w0 = within(*now, limits)
    v, w = within(*wanted, limits)
    if v * v0 < 0.0:
        v = 0.0
    most = (limits.acceleration if abs(v) > abs(v0) else braking_rate(limits)) * seconds
    v = v0 + min(max(v - v0, -most), most)
    bound, change = turn_bound(v, limits), limits.turn_acceleration * seconds
    return v, min(max(w, -bound, w0 - change), bound, w0 + change)
