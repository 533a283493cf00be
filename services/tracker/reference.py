"""What the controller is to follow over its horizon: the path's speed profile, rolled out from where the robot is."""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from services.tracker.limits import Limits
from services.tracker.mpc import MpcSettings, Reference
from services.tracker.path import Path, Section
from services.tracker.speed import limit_between, speed_profile

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Profile:
    """The speeds of a section: ``speed`` (M,) at its samples; ``between`` (M-1,), the limit from each to the next.

    Lists, as a roll-out reads single numbers; ``limited`` says whether any limit is finite.
    """

    section: Section
    s: list[float]
    speed: list[float]
    between: list[float]
    limited: bool


def make_profiles(path: Path, stretch_limits: Array, limits: Limits) -> list[Profile]:
    """The profile of each section of a path whose stretches have limits (N,), one a vertex."""
    profiles = []
    for section in path.sections:
        mine = slice(section.first_vertex, section.last_vertex + 1)
        between = limit_between(section.s, path.vertex_s[mine], stretch_limits[mine])
        speed = speed_profile(section.s, section.curvature, limits, between)
        limited = bool(np.isfinite(between).any())
        profiles.append(Profile(section, section.s.tolist(), speed.tolist(), between.tolist(), limited))
    return profiles


def roll_out(
    profile: Profile, s: float, v: float, scale: float, creep: float, limits: Limits, settings: MpcSettings
) -> Reference:
    """The reference from arclength ``s`` and speed ``v`` on, at ``scale`` of the profile but no slower than ``creep``.

    What a stretch's limit is holds without exception: the reference's speed and its ``most`` keep within it.
    """
    samples, step = profile.s, settings.step
    end, last = samples[-1], len(profile.between) - 1
    creep, gain = min(creep, limits.speed), limits.acceleration * step
    at, speed = [s], [v]
    here = min(max(bisect_right(samples, s) - 1, 0), last)
    for _ in range(settings.horizon):
        while here < last and samples[here + 1] <= at[-1]:
            here += 1
        allowed = max(scale * _speed_at(profile, here, at[-1]), min(creep, profile.between[here]))
        speed.append(min(allowed, speed[-1] + gain, max(end - at[-1], 0.0) / step))
        at.append(min(at[-1] + 0.5 * (speed[-2] + speed[-1]) * step, max(end, s)))
    most = _most(profile, at, speed, settings) if profile.limited else None
    places = np.array(at)
    return Reference(places, np.array(speed), np.interp(places, profile.section.s, profile.section.curvature), most)


def _speed_at(profile: Profile, here: int, s: float) -> float:
    """The profile's speed at ``s``, of the samples ``here`` and the next one; that of the ends beyond them."""
    before, after = profile.s[here], profile.s[here + 1]
    share = min(max((s - before) / (after - before), 0.0), 1.0) if after > before else 1.0
    return profile.speed[here] + share * (profile.speed[here + 1] - profile.speed[here])


def _most(profile: Profile, at: list[float], speed: list[float], settings: MpcSettings) -> Array:
    """The highest command (n,) that the stretches allow in each step, seen as far ahead as the base lags."""
    last = len(profile.between) - 1
    most = []
    for k in range(settings.horizon):
        first = min(max(bisect_right(profile.s, at[k]) - 1, 0), last)
        beyond = bisect_left(profile.s, at[k + 1] + settings.lag * speed[k + 1])
        most.append(min(profile.between[first : max(beyond, first + 1)]))
    return np.array(most)
