"""Polygons around the robot, how many points lie in them, and when that counts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from common.geometry import Array

Corner = tuple[float, float]


class ZoneError(ValueError):
    """A polygon that encloses nothing."""


class Found(IntEnum):
    """What lies in the way; the greater, the graver."""

    CLEAR = 0
    SLOW = 1
    STOP = 2


@dataclass(frozen=True, slots=True)
class ZoneSettings:
    """Where things are in the way, and how sure that must be. Metres in the vehicle frame (x forward, y left, z up).

    Attributes:
        stop, slow: corners ``[x, y]`` of the polygons in which something stops the robot, or slows it down.
        lowest, highest: heights above the ground between which a point is no ground and no branch overhead.
        points: so many of them in a polygon are something.
        looks: in so many looks one after another.
        clear_s: nothing for so many seconds, and the way is free again.
    """

    stop: tuple[Corner, ...] = ((0.2, -0.5), (1.5, -0.5), (1.5, 0.5), (0.2, 0.5))
    slow: tuple[Corner, ...] = ((0.2, -0.7), (3.5, -0.7), (3.5, 0.7), (0.2, 0.7))
    lowest: float = 0.25
    highest: float = 1.8
    points: int = 25
    looks: int = 2
    clear_s: float = 1.0

    def __post_init__(self) -> None:
        """Refuses what is no zone.

        Raises:
            ZoneError: a polygon has no area, or the heights no room between them.
        """
        for name, corners in (("stop", self.stop), ("slow", self.slow)):
            if len(corners) < 3 or area(corners) < 1e-3:
                raise ZoneError(f"the zone `{name}` needs three corners or more that enclose an area")
        if not self.lowest < self.highest:
            raise ZoneError("`lowest` lies below `highest`")


def area(corners: Sequence[Corner]) -> float:
    """Of a polygon, square metres."""
    x, y = np.array(corners, dtype=np.float64).T
    return 0.5 * abs(float(x @ np.roll(y, -1) - y @ np.roll(x, -1)))


def inside(points: Array, corners: Sequence[Corner]) -> NDArray[np.bool_]:
    """Which points (N, 2 or more) lie in a polygon, by the crossings of a ray along x (even-odd rule)."""
    x, y = points[:, 0], points[:, 1]
    odd = np.zeros(len(points), dtype=np.bool_)
    for (x0, y0), (x1, y1) in zip(corners, [*corners[1:], corners[0]], strict=True):
        if y0 == y1:
            continue
        crosses = (y0 > y) != (y1 > y)
        odd ^= crosses & (x < x0 + (y - y0) * (x1 - x0) / (y1 - y0))
    return odd


@dataclass(frozen=True, slots=True)
class Look:
    """One look: how many points lie in each polygon, and how far the nearest of them is from the vehicle (m)."""

    stop: int
    slow: int
    nearest: float | None


def look(points: Array, settings: ZoneSettings) -> Look:
    """Counts the points (N, 3) of the vehicle frame that stand up from the ground in each polygon."""
    high = (points[:, 2] > settings.lowest) & (points[:, 2] < settings.highest)
    standing = points[high & np.isfinite(points).all(axis=1)]
    stop, slow = inside(standing, settings.stop), inside(standing, settings.slow)
    within = standing[stop | slow, :2]
    nearest = float(np.linalg.norm(within, axis=1).min()) if len(within) else None
    return Look(int(stop.sum()), int(slow.sum()), nearest)


@dataclass(slots=True)
class Watch:
    """Remembers looks: something counts when it was seen again and again, and is gone when it was not for a while."""

    settings: ZoneSettings
    _seen: dict[Found, int] = field(default_factory=lambda: {Found.STOP: 0, Found.SLOW: 0})
    _last: dict[Found, float] = field(default_factory=dict)

    def see(self, now: float, found: Look) -> Found:
        """What lies in the way after a look at ``now``, seconds of a monotonic clock."""
        for zone, count in ((Found.STOP, found.stop), (Found.SLOW, found.slow)):
            self._seen[zone] = self._seen[zone] + 1 if count >= self.settings.points else 0
            held = zone in self._last and self._seen[zone] > 0
            if held or self._seen[zone] >= self.settings.looks:
                self._last[zone] = now
            elif zone in self._last and now - self._last[zone] > self.settings.clear_s:
                del self._last[zone]
        return max(self._last, default=Found.CLEAR)
