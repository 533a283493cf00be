"""Replays taught actions by distance and corrects the heading: how a route without metric poses is followed.

The action is that of the present distance along the map, as the thesis's VT&R has it (section 2.1). Turning towards
the taught heading *as the images tell it* brings the robot back to the path as well: beside the path the scene is seen
turned by about offset / depth, so the robot aims inwards by as much, and meets the path within a few depths.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import Field

from services.tracker.follower import TrackerOutput
from services.tracker.limits import Limits
from services.tracker.path import RouteError
from services.tracker.ramp import approach, brake
from services.tracker.speed import CautionSettings, caution, planned_deceleration
from services.tracker.taught import Action, TaughtWay, action_at

Array = NDArray[np.float64]
Positive = Annotated[float, Field(gt=0)]


_NO_ACTION = "stopping, as no taught action is known here"


@dataclass(frozen=True, slots=True)
class ReplaySettings:
    """How taught actions are replayed: SI units.

    Attributes:
        gain: of the turn on the heading offset, radians a metre for each radian: 1 / gain is the way in which a wrong
            heading is corrected. It must be long beside what the robot drives between a frame and its effect.
        largest: heading offset beyond which the correction grows no more, so that one wrong image does little.
        tolerance: metres from the end at which the robot has arrived.
        creep: least speed on the way, as taught stops are not repeated.
        sigma_free, sigma_worst: standard deviation of the distance along the map at which the robot begins to slow
            down, and at which it is slowest; metres.
        turn_beyond, turn_until: heading offset beyond which a unicycle turns on the spot, and until which; at the start
            it turns in any case.
        at_rest: m/s and rad/s below which the robot stands.
        look_ahead: seconds before a stretch with a speed limit by which the command keeps to it: the base's lag.
    """

    gain: Positive = 1.0
    largest: Positive = 0.35
    tolerance: Positive = 0.05
    creep: Positive = 0.15
    sigma_free: Positive = 0.4
    sigma_worst: Positive = 1.2
    turn_beyond: Positive = 0.8
    turn_until: Positive = 0.05
    at_rest: Positive = 0.03
    look_ahead: Positive = 0.3


@dataclass(frozen=True, slots=True)
class Motion:
    """What the robot did since the frame of a localization: ``T_frame_*`` (4, 4), and its speeds when a command acts.

    Attributes:
        T_frame_now: until now, when a command is sent.
        T_frame_acting: until that command acts.
        v, w: m/s and rad/s then.
    """

    T_frame_now: Array
    T_frame_acting: Array
    v: float
    w: float


class ActionReplay:
    """Follows one route after another by replaying its actions. Not thread-safe; knows no clock and no bus."""

    def __init__(
        self, limits: Limits, caution_settings: CautionSettings, settings: ReplaySettings | None = None
    ) -> None:
        self._limits = limits
        self._settings = settings or ReplaySettings()
        s = self._settings
        self._caution = CautionSettings(
            caution_settings.metres_free, caution_settings.metres_worst,
            caution_settings.seconds_free, caution_settings.seconds_worst,
            s.sigma_free, s.sigma_worst, caution_settings.slowest,
        )  # fmt: skip
        self._way: TaughtWay | None = None
        self._v, self._w = 0.0, 0.0
        self._turning = False
        self._finished = False

    def set_route(self, poses: ArrayLike, speed_limits: ArrayLike = ()) -> None:
        """Follow a route, from the poses (N, 4, 4) of its vertices in any one frame, with limits (N,) as the follower.

        A unicycle turns to the taught heading first: what it drives meanwhile would lead it away from the path. The
        taught speed is lowered to the limits, and the turn rate with it, so that the curve stays the taught one.

        Raises:
            LimitError: the speed limits are not as many as the vertices, or one is not positive.
        """
        self._way = TaughtWay(poses, speed_limits, planned_deceleration(self._limits))
        self._turning, self._finished = True, False

    def reset_command(self, v: float = 0.0, w: float = 0.0) -> None:
        """Say what the robot is really doing, where that is not the last command."""
        self._v, self._w = v, w

    def update(
        self,
        trunk_index: int,
        T_trunk_robot: ArrayLike,
        covariance: ArrayLike,
        actions: ArrayLike,
        motion: Motion,
        metres_since_success: float,
        seconds_since_success: float,
        dt: float,
    ) -> TrackerOutput:
        """The command for the next ``dt`` seconds, from a localization and what the robot did since its frame.

        Raises:
            RouteError: there is no route, or it has no such vertex.
        """
        way = self._way
        if way is None:
            raise RouteError("The tracker has no route to replay.")
        then, offset = way.place(trunk_index, T_trunk_robot)
        first = action_at(actions, 0.0, self._settings.at_rest)
        direction = -1.0 if first is not None and first.v < 0.0 else 1.0
        # The correction acts after the base's delay; the taught command acted as late after its own place.
        _, offset_then = way.moved(then, offset, motion.T_frame_acting, direction)
        here, _ = way.moved(then, offset, motion.T_frame_now, direction)
        remaining = way.length - here
        standing = abs(motion.v) < self._settings.at_rest and abs(motion.w) < self._settings.at_rest
        action = action_at(actions, here - then, self._settings.at_rest)
        if self._finished or remaining <= self._settings.tolerance or action is None:
            self._v, self._w = brake(self._v, self._w, dt, self._limits)
            arrived = remaining <= self._settings.tolerance
            self._finished = self._finished or (arrived and standing and self._v == 0.0 and self._w == 0.0)
            reason = "at the end" if self._finished else "stopping at the end"
            return self._output(here, remaining, offset_then, reason if arrived or self._finished else _NO_ACTION)
        scale = caution(metres_since_success, seconds_since_success, _along(covariance), self._caution)
        # The speed follows its command late: what is in force a lag ahead is what the robot will have.
        fastest = way.fastest(here + self._settings.look_ahead * abs(motion.v))
        reason = self._drive(action, offset_then, remaining, (scale, min(way.fastest(here), fastest)), dt)
        return self._output(here, remaining, offset_then, reason)

    def _drive(self, action: Action, offset: float, remaining: float, bounds: tuple[float, float], dt: float) -> str:
        """Sets the next command, at a share of the taught speed but no faster than the route allows (``bounds``).

        Returns what it does other than replay.
        """
        s, limits, (scale, fastest) = self._settings, self._limits, bounds
        if self._must_turn(offset):
            # Half of the braking acceleration, as the base answers late.
            rate = min(math.sqrt(limits.turn_acceleration * abs(offset)), limits.turn_rate)
            self._approach(0.0, -math.copysign(rate, offset), dt)
            return "turning on the spot to the taught heading"
        stop = math.sqrt(2.0 * planned_deceleration(limits) * max(remaining - s.tolerance / 2.0, 0.0))
        speed = min(max(scale * min(abs(action.v), limits.speed), s.creep), max(stop, s.creep / 2.0), fastest)
        correction = -s.gain * min(max(offset, -s.largest), s.largest)
        curvature = action.curvature * math.copysign(1.0, action.v)
        turn = speed * (curvature + correction)
        if limits.curvature is not None:
            bound = limits.curvature * speed
            turn = min(max(turn, -bound), bound)
        if abs(turn) > limits.turn_rate:
            speed, turn = speed * limits.turn_rate / abs(turn), math.copysign(limits.turn_rate, turn)
        self._approach(math.copysign(speed, action.v), turn, dt)
        return f"driving at {scale:.0%} of the speed, as the localization is poor" if scale < 1.0 else ""

    def _must_turn(self, offset: float) -> bool:
        """Whether to turn on the spot, with hysteresis; never for a vehicle that cannot."""
        if not self._limits.turns_on_the_spot:
            return False
        bound = self._settings.turn_until if self._turning else self._settings.turn_beyond
        self._turning = abs(offset) > bound
        return self._turning

    def _approach(self, v: float, w: float, dt: float) -> None:
        self._v, self._w = approach((self._v, self._w), (v, w), dt, self._limits)

    def _output(self, here: float, remaining: float, offset: float, reason: str) -> TrackerOutput:
        return TrackerOutput(self._v, self._w, 0.0, offset, here, max(remaining, 0.0), self._finished, reason)


def _along(covariance: ArrayLike) -> NDArray[Any]:
    """A covariance (6, 6) of which only what a bearing map measures in the plane is left: the distance along it."""
    kept = np.zeros((6, 6))
    kept[0, 0] = np.asarray(covariance, dtype=np.float64)[0, 0]
    return kept
