"""Follows a route: from where the robot is on it to the velocity command of this cycle."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from services.tracker.limits import Limits
from services.tracker.mpc import MpcSettings, PathMpc, State
from services.tracker.path import Path, PathSettings, Projection, make_path, wrap
from services.tracker.ramp import approach, brake
from services.tracker.reference import Profile, make_profiles, roll_out
from services.tracker.speed import CautionSettings, caution, checked_limits

if TYPE_CHECKING:
    from numpy.typing import ArrayLike


@dataclass(frozen=True, slots=True)
class FollowerSettings:
    """Everything the tracker can be told. Metres, radians, seconds.

    Attributes:
        limits: what the vehicle may do.
        path: how a route becomes a path.
        mpc: the model-predictive controller.
        caution: when to slow down for poor localization.
        tolerance: the robot has arrived when it stands this close to the end of the route, or of a section of it.
        creep: speed of the last bit, m/s, as no base follows ever smaller speeds.
        turn_beyond: a unicycle whose heading is off by more turns on the spot first, and another vehicle stops.
        turn_until: and goes on once it is off by less than this.
        at_rest: below so many m/s and rad/s it stands.
    """

    limits: Limits = field(default_factory=Limits)
    path: PathSettings = field(default_factory=PathSettings)
    mpc: MpcSettings = field(default_factory=MpcSettings)
    caution: CautionSettings = field(default_factory=CautionSettings)
    tolerance: float = 0.05
    creep: float = 0.08
    turn_beyond: float = 1.0
    turn_until: float = 0.1
    at_rest: float = 0.03


@dataclass(frozen=True, slots=True)
class TrackerOutput:
    """A command (m/s forwards, rad/s to the left) and where the robot is on the route.

    ``lateral_error`` (m) is positive left of the path as seen along the direction of travel, ``heading_error`` (rad)
    is the robot's heading less the taught one, ``arclength`` and ``remaining`` are metres along the whole route.
    ``reason`` says what the robot does other than follow the path, or is empty.
    """

    v: float
    w: float
    lateral_error: float
    heading_error: float
    arclength: float
    remaining: float
    finished: bool
    reason: str = ""


class NoRouteError(RuntimeError):
    """An update without a route to follow."""


@dataclass(slots=True)
class _Progress:
    """How far the robot has come on its route: the section driven now, None before the first update."""

    path: Path
    profiles: list[Profile]
    section: int | None = None
    turning: bool = False
    finished: bool = False


class PathFollower:
    """Follows one route after another. Not thread-safe; knows no clock and no bus."""

    def __init__(self, settings: FollowerSettings | None = None) -> None:
        self._settings = settings or FollowerSettings()
        self._limits = self._settings.limits
        self._mpc = PathMpc(self._limits, self._settings.mpc)
        self._progress: _Progress | None = None
        self._v, self._w = 0.0, 0.0

    @property
    def path(self) -> Path | None:
        """The path that is followed."""
        return self._progress.path if self._progress else None

    def set_route(self, poses: ArrayLike, speed_limits: ArrayLike = ()) -> None:
        """Follow a route, from the poses (N, 4, 4) of its vertices in any one frame. The last command is kept.

        ``speed_limits`` (N,), m/s, hold on the stretch from each vertex to the next: none, or one for each.

        Raises:
            RouteError: there is no vertex, or a pose is no finite rigid transform.
            LimitError: the speed limits are not as many as the vertices, or one is not positive.
        """
        path = make_path(poses, self._settings.path)
        stretch_limits = checked_limits(speed_limits, len(path.vertices))
        self._progress = _Progress(path, make_profiles(path, stretch_limits, self._limits))

    def reset_command(self, v: float = 0.0, w: float = 0.0) -> None:
        """Say what the robot is really doing, where that is not the last command: while safety holds it, say."""
        self._v, self._w = v, w

    def update(
        self,
        trunk_index: int,
        T_trunk_robot: ArrayLike,
        covariance: ArrayLike,
        v_now: float,
        w_now: float,
        metres_since_success: float,
        seconds_since_success: float,
        dt: float,
    ) -> TrackerOutput:
        """The command for the next ``dt`` seconds.

        The pose (4, 4), its covariance (6, 6) and the speeds are those predicted for the time when the command acts.

        Raises:
            NoRouteError: there is no route.
            RouteError: the route has no such vertex, or the pose is no finite rigid transform.
        """
        progress = self._progress
        if progress is None:
            raise NoRouteError("The tracker has no route to follow.")
        pose = progress.path.place(trunk_index, T_trunk_robot)
        standing = abs(v_now) < self._settings.at_rest and abs(w_now) < self._settings.at_rest
        if not progress.path.sections:
            return self._stand(progress, Projection(0.0, 0.0, 0.0), standing=standing, dt=dt)
        section = self._section(progress, trunk_index, pose, standing=standing)
        place = progress.path.project(section, trunk_index, pose)
        arrived = self._arrived(progress.path, section, place.s)
        if progress.finished or (arrived and section == len(progress.path.sections) - 1):
            return self._stand(progress, place, standing=standing, dt=dt)
        if arrived:
            self._brake(dt)
            return self._output(progress, place, "stopping at the end of a section")
        scale = caution(metres_since_success, seconds_since_success, covariance, self._settings.caution)
        return self._output(progress, place, self._drive(progress, section, place, (v_now, w_now), scale, dt))

    def _section(
        self, progress: _Progress, trunk_index: int, pose: tuple[float, float, float], *, standing: bool
    ) -> int:
        """The section to drive now: the next one, once the robot stands at the end of this one."""
        path, section = progress.path, progress.section
        if section is None or self._strayed(path, section, trunk_index):
            section = path.section_of(trunk_index)
        elif section < len(path.sections) - 1 and standing and self._v == 0.0:
            place = path.project(section, trunk_index, pose)
            if self._arrived(path, section, place.s):
                section += 1
                progress.turning = True
        progress.section = section
        return section

    @staticmethod
    def _strayed(path: Path, section: int, trunk_index: int) -> bool:
        """Whether the trunk is on another part of the route altogether, as after somebody has moved the robot."""
        s, driven = path.vertex_s[trunk_index], path.sections[section]
        return bool(s < driven.start - path.search or s > driven.end + path.search)

    def _arrived(self, path: Path, section: int, s: float) -> bool:
        """Whether so little is left of a section that it is done once the robot stands."""
        left = path.sections[section].end - s
        tolerance = self._settings.tolerance
        return left <= 0.4 * tolerance or (left <= tolerance and abs(self._v) <= self._settings.creep)

    def _brake(self, dt: float) -> None:
        self._v, self._w = brake(self._v, self._w, dt, self._limits)

    def _drive(
        self,
        progress: _Progress,
        section: int,
        place: Projection,
        speeds: tuple[float, float],
        scale: float,
        dt: float,
    ) -> str:
        """Set the next command; returns what it does, where that is not following the path."""
        direction = progress.path.sections[section].direction
        if self._v * direction < 0.0:
            self._brake(dt)
            return "stopping before driving the other way"
        if self._must_turn(progress, place.heading):
            self._turn(place.heading, dt)
            return "turning on the spot"
        if abs(place.heading) > self._settings.turn_beyond and not self._limits.turns_on_the_spot:
            self._brake(dt)
            return f"stopping, as the robot faces {math.degrees(place.heading):.0f} degrees off and cannot turn there"
        profile, creep = progress.profiles[section], self._settings.creep
        reference = roll_out(profile, place.s, abs(self._v), scale, creep, self._limits, self._settings.mpc)
        forwards = (direction * speeds[0], speeds[1], direction * self._v, self._w)
        command = self._mpc.solve(State(place.s, place.lateral, place.heading, *forwards), reference, dt)
        self._v, self._w = direction * command.v, command.w
        if command.problem:
            return f"stopping, as {command.problem}"
        return f"driving at {scale:.0%} of the speed, as the localization is poor" if scale < 1.0 else ""

    def _must_turn(self, progress: _Progress, heading_error: float) -> bool:
        """Whether to turn on the spot, with hysteresis; never for a vehicle that cannot."""
        if not self._limits.turns_on_the_spot:
            return False
        bound = self._settings.turn_until if progress.turning else self._settings.turn_beyond
        progress.turning = abs(heading_error) > bound
        return progress.turning

    def _turn(self, heading_error: float, dt: float) -> None:
        """One cycle of turning on the spot, at a rate from which the robot can still stop in time."""
        if self._v != 0.0:
            self._brake(dt)
            return
        # Half of the braking acceleration, as the base answers late.
        rate = min(math.sqrt(self._limits.turn_acceleration * abs(heading_error)), self._limits.turn_rate)
        wanted = 0.0, -math.copysign(rate, heading_error)
        self._v, self._w = approach((self._v, self._w), wanted, dt, self._limits)

    def _stand(self, progress: _Progress, place: Projection, *, standing: bool, dt: float) -> TrackerOutput:
        """Stop, or stay, at the end of the route."""
        self._brake(dt)
        progress.finished = progress.finished or (standing and self._v == 0.0 and self._w == 0.0)
        return self._output(progress, place, "at the end" if progress.finished else "stopping at the end")

    def _output(self, progress: _Progress, place: Projection, reason: str) -> TrackerOutput:
        remaining = max(progress.path.length - place.s, 0.0)
        errors = (place.lateral, wrap(place.heading))
        return TrackerOutput(self._v, self._w, *errors, place.s, remaining, progress.finished, reason)
