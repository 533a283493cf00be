"""The demo's human: drives a wanted path by looking at where the robot truly is, as one does with one's eyes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from common import geometry
from common.geometry import Array


@dataclass(frozen=True, slots=True)
class DriverSettings:
    """How the human drives.

    Attributes:
        speed: on straight ground, m/s.
        look_ahead: distance of the point that is steered to, metres.
        lateral_acceleration: that a curve is taken with at most, m/s^2.
        acceleration: when setting off, m/s^2.
    """

    speed: float = 1.2
    look_ahead: float = 1.2
    lateral_acceleration: float = 0.8
    acceleration: float = 0.6


class Driver:
    """Pure pursuit (Coulter, 1992) of a path (N, 3) of x, y, yaw in the plane."""

    def __init__(self, path: Array, settings: DriverSettings | None = None) -> None:
        self._path = np.asarray(path, dtype=np.float64)
        self._settings = settings or DriverSettings()
        self._arclength = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(self._path[:, :2], axis=0), axis=1))])
        self._nearest = 0
        self._speed = 0.0

    @property
    def progress(self) -> float:
        """Metres of the path that lie behind."""
        return float(self._arclength[self._nearest])

    @property
    def length(self) -> float:
        """Length of the path, metres."""
        return float(self._arclength[-1])

    def command(self, T_world_vehicle: Array, dt: float) -> tuple[float, float] | None:
        """Speed and turn rate for a pose, called every ``dt`` seconds; None at the end of the path."""
        s = self._settings
        position = T_world_vehicle[:2, 3]
        ahead = slice(self._nearest, self._nearest + 40)
        self._nearest += int(np.argmin(np.linalg.norm(self._path[ahead, :2] - position, axis=1)))
        remaining = self.length - self.progress
        if remaining < 0.05:
            return None
        target = int(np.searchsorted(self._arclength, self.progress + s.look_ahead))
        x, y = self._target(target, position, float(geometry.yaw_of(T_world_vehicle)))
        curvature = 2.0 * y / max(x * x + y * y, 1e-6)
        limit = min(s.speed, np.sqrt(s.lateral_acceleration / max(abs(curvature), 1e-6)), 0.15 + remaining * 0.8)
        self._speed = float(min(limit, self._speed + s.acceleration * dt))
        return self._speed, self._speed * curvature

    def _target(self, index: int, position: Array, yaw: float) -> Array:
        """The point to steer to, in the vehicle's frame; beyond the end the path goes on straight."""
        if index < len(self._path):
            point = self._path[index, :2]
        else:
            x, y, heading = self._path[-1]
            beyond = self._settings.look_ahead - (self.length - self.progress)
            point = np.array([x, y]) + beyond * np.array([np.cos(heading), np.sin(heading)])
        d = point - position
        return np.array([np.cos(yaw) * d[0] + np.sin(yaw) * d[1], -np.sin(yaw) * d[0] + np.cos(yaw) * d[1]])
