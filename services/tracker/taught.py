"""What a route that is known by bearing alone consists of: distances, headings, and the actions taught there."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from common.geometry import arclength, inverse, yaw_of
from services.tracker.path import pose_at_trunk, wrap
from services.tracker.speed import braking_bound, checked_limits


class TaughtWay:
    """A route as its wheels knew it: distances ``metres`` (N,) and unwrapped headings ``yaw`` (N,) of its vertices.

    ``limits`` (N,), m/s, hold from each vertex to the next; ``entry`` (N,) are the speeds at which a robot may come to
    each vertex, so that it keeps to all limits from there on.
    """

    def __init__(self, poses: ArrayLike, speed_limits: ArrayLike = (), deceleration: float = 0.3) -> None:
        """From the poses (N, 4, 4) of the route's vertices in any one frame, and one limit a vertex or none.

        ``deceleration`` (m/s^2) is what a robot brakes with towards a lower limit.

        Raises:
            LimitError: the speed limits are not as many as the vertices, or one is not positive.
        """
        T = np.asarray(poses, dtype=np.float64)
        self.metres = arclength(T)
        self.yaw = np.concatenate([[0.0], np.cumsum(yaw_of(inverse(T[:-1]) @ T[1:]))])
        self.limits = checked_limits(speed_limits, len(T))
        self._deceleration = deceleration
        self.entry = braking_bound(self.metres, self.limits, deceleration)

    def fastest(self, metres: float) -> float:
        """The highest speed at a distance along the route that keeps to the limits there and further on, m/s."""
        at = min(max(int(np.searchsorted(self.metres, metres, side="right")) - 1, 0), len(self.metres) - 1)
        if at == len(self.metres) - 1:
            return float(self.limits[at])
        ahead = max(float(self.metres[at + 1]) - metres, 0.0)
        return min(float(self.limits[at]), math.sqrt(self.entry[at + 1] ** 2 + 2.0 * self._deceleration * ahead))

    @property
    def length(self) -> float:
        """Metres of the whole route."""
        return float(self.metres[-1])

    def place(self, trunk_index: int, T_trunk_robot: ArrayLike) -> tuple[float, float]:
        """Metres along the route, and heading offset to the taught heading there, of a robot near its trunk.

        Raises:
            RouteError: the route has no such vertex, or the pose is none near it.
        """
        T = pose_at_trunk(trunk_index, T_trunk_robot, len(self.metres))
        metres = float(self.metres[trunk_index] + T[0, 3])
        return metres, wrap(float(yaw_of(T)) - self._turn(float(self.metres[trunk_index]), metres))

    def moved(self, metres: float, offset: float, T_then_now: ArrayLike, direction: float) -> tuple[float, float]:
        """A place and a heading offset, moved on by what the wheels did since: ``direction`` is -1 where backwards."""
        T = np.asarray(T_then_now, dtype=np.float64)
        along = direction * math.copysign(float(np.hypot(T[0, 3], T[1, 3])), float(T[0, 3]))
        return metres + along, wrap(offset + float(yaw_of(T)) - self._turn(metres, metres + along))

    def _turn(self, start: float, end: float) -> float:
        before, after = np.interp([start, end], self.metres, self.yaw)
        return float(after - before)


@dataclass(frozen=True, slots=True)
class Action:
    """What was taught at a place: speed in m/s, negative backwards, and curvature in 1/m."""

    v: float
    curvature: float


def action_at(actions: ArrayLike, metres: float, still: float) -> Action | None:
    """The action ``metres`` ahead of where ``actions`` (K, 3) ``[metres, v, w]`` count from, between the two nearest.

    Rows slower than ``still`` are left out: a stop is not repeated, and says nothing of the curve. None where all are.
    """
    rows = np.asarray(actions, dtype=np.float64).reshape(-1, 3)
    rows = rows[np.abs(rows[:, 1]) > still]
    if len(rows) == 0:
        return None
    nearest = rows[np.argmin(np.abs(rows[:, 0] - metres))]
    same = rows[np.sign(rows[:, 1]) == np.sign(nearest[1])]
    v = float(np.interp(metres, same[:, 0], same[:, 1]))
    return Action(v, float(np.interp(metres, same[:, 0], same[:, 2] / same[:, 1])))
