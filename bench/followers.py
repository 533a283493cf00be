"""The peers of the model-predictive follower: a pure pursuit and a PID, with all that a real follower needs.

Both drive the same smoothed path in the same sections at the same speed profile, and every command is brought within
the same limits, so only the steering differs. Their gains are those of least mean lateral error over all routes of
``bench.tracking`` on a base whose delay is known, found by ``python -m bench.tracking --tune``.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from services.tracker.limits import Limits
from services.tracker.path import Path, Projection, Section, make_path
from services.tracker.ramp import approach
from services.tracker.reference import Profile, make_profiles

Array = NDArray[np.float64]

_TOLERANCE, _CREEP, _AT_REST = 0.02, 0.08, 0.03


class Law(Protocol):
    """How to steer."""

    def turn_rate(self, section: Section, place: Projection, v: float, dt: float) -> float:
        """The turn rate (rad/s) at a speed along the direction of travel, m/s."""

    def reset(self) -> None:
        """A new section begins."""


@dataclass(slots=True)
class PurePursuit:
    """Drives the arc to the point of the path a distance ahead that grows with the speed (Coulter, 1992)."""

    metres: float = 0.6
    seconds: float = 0.5

    def turn_rate(self, section: Section, place: Projection, v: float, dt: float) -> float:  # noqa: ARG002
        """Along the arc to the point ahead."""
        s = min(max(place.s, section.start), section.end)
        ahead = s + self.metres + self.seconds * v
        tangent, last = (float(np.interp(at, section.s, section.heading)) for at in (s, section.end))
        axes = section.x, section.y
        here, goal = (np.array([np.interp(at, section.s, axis) for axis in axes]) for at in (s, ahead))
        # Beyond the end the path runs on along its last tangent, or a robot near the end would chase a point beside it.
        goal = goal + max(ahead - section.end, 0.0) * np.array([math.cos(last), math.sin(last)])
        robot = here + place.lateral * np.array([-math.sin(tangent), math.cos(tangent)])
        chord = goal - robot
        bearing = math.atan2(chord[1], chord[0]) - tangent - place.heading
        return v * 2.0 * math.sin(bearing) / max(float(np.linalg.norm(chord)), 0.1)

    def reset(self) -> None:
        """It remembers nothing."""


@dataclass(slots=True)
class Pid:
    """The path's curvature, and a PID on the lateral error, whose rate is the speed times the heading error."""

    proportional: float = 1.5
    integral: float = 0.1
    derivative: float = 2.0
    _sum: float = 0.0

    def turn_rate(self, section: Section, place: Projection, v: float, dt: float) -> float:
        """The path's own and the PID's."""
        # Bounded, or the way from beside the start would wind it up.
        self._sum = min(max(self._sum + place.lateral * dt, -0.3), 0.3)
        bend = v * float(np.interp(place.s, section.s, section.curvature))
        error, rate = place.lateral, v * math.sin(place.heading)
        return bend - self.proportional * error - self.derivative * rate - self.integral * self._sum

    def reset(self) -> None:
        """Forgets the integral."""
        self._sum = 0.0


class LawFollower:
    """Drives a route section by section, steered by a law."""

    def __init__(self, route: Array, law: Law, limits: Limits, lag: float) -> None:
        """From the route's poses (N, 4, 4); ``lag`` (s) is how far ahead the speed is chosen, as the base is late."""
        self._path: Path = make_path(route)
        self._profiles: list[Profile] = make_profiles(self._path, np.full(len(route), np.inf), limits)
        self._law, self._limits, self._lag = law, limits, lag
        self._section = 0
        self._command = 0.0, 0.0

    def __call__(self, trunk: int, T_trunk_robot: Array, v: float, w: float, dt: float) -> tuple[float, float, bool]:
        """A command, as the simulation asks for it."""
        pose = self._path.place(trunk, T_trunk_robot)
        place = self._path.project(self._section, trunk, pose)
        section = self._path.sections[self._section]
        arrived = section.end - place.s <= _TOLERANCE
        wanted = (0.0, 0.0) if arrived else self._steer(section, place, dt)
        self._command = approach(self._command, wanted, dt, self._limits)
        standing = arrived and abs(v) < _AT_REST and abs(w) < _AT_REST and self._command == (0.0, 0.0)
        last = self._section == len(self._path.sections) - 1
        if standing and not last:
            self._section += 1
            self._law.reset()
        return *self._command, standing and last

    def _steer(self, section: Section, place: Projection, dt: float) -> tuple[float, float]:
        direction, now = section.direction, abs(self._command[0])
        profile = self._profiles[self._section]
        speed = max(float(np.interp(place.s + self._lag * now, profile.s, profile.speed)), _CREEP)
        return direction * speed, self._law.turn_rate(section, place, now, dt)
