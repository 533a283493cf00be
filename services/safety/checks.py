"""What each of safety's rules looks at: a sentence where it objects, else None.

Ages are seconds of the monotonic clock since the local arrival; None stands for what never arrived. Every comparison is
written so that NaN objects.
"""

from __future__ import annotations

import math

import numpy as np

from common.messages import Zone
from services.safety.inputs import SafetyInputs
from services.safety.limits import RuleSettings

_HUGE_M_S, _HUGE_RAD_S = 5.0, 10.0
"""A command beyond these, or one that is not finite, was made by a fault: it is not clipped, but stops the robot."""


def _stale(what: str, age: float | None, limit: float) -> str | None:
    if age is None:
        return f"No {what} has arrived."
    return None if age <= limit else f"The last {what} is {age:.2f} s old; the limit is {limit:.2f} s."


def emergency_stop(inputs: SafetyInputs, _: RuleSettings) -> str | None:
    """The emergency stop is latched."""
    return None if inputs.estop is None else f"The emergency stop is latched: {inputs.estop}"


def rearming(inputs: SafetyInputs, _: RuleSettings) -> str | None:
    """An emergency stop was reset, and a command to move still arrives."""
    return "After an emergency stop the robot waits until no command to move arrives." if inputs.rearming else None


def state_unknown(inputs: SafetyInputs, settings: RuleSettings) -> str | None:
    """Nobody knows the state."""
    return _stale("state", None if inputs.state is None else inputs.state_age, settings.state_age)


def state_forbids(inputs: SafetyInputs, _: RuleSettings) -> str | None:
    """The state lets no command through."""
    return None if inputs.state is None else f"The state {inputs.state} allows no motion."


def command_stale(inputs: SafetyInputs, settings: RuleSettings) -> str | None:
    """The command is too old, or there is none."""
    return _stale("command", None if inputs.command is None else inputs.command.age, settings.command_age)


def command_kind(inputs: SafetyInputs, _: RuleSettings) -> str | None:
    """The command is not of the kind that the state lets through."""
    if inputs.command is None or inputs.command.kind is inputs.motion:
        return None
    return f"The state {inputs.state} takes {inputs.motion} commands only, and this one is {inputs.command.kind}."


def command_invalid(inputs: SafetyInputs, _: RuleSettings) -> str | None:
    """The command is none that a robot is given."""
    command = inputs.command
    if command is None or (abs(command.v) <= _HUGE_M_S and abs(command.w) <= _HUGE_RAD_S):
        return None
    return f"The command ({command.v:.4g} m/s, {command.w:.4g} rad/s) is none that a robot is given."


def service_missing(inputs: SafetyInputs, _: RuleSettings) -> str | None:
    """A process without which the robot must not move is not present."""
    return f"A needed service is not present: {', '.join(inputs.missing)}." if inputs.missing else None


def dead_mans_switch(inputs: SafetyInputs, settings: RuleSettings) -> str | None:
    """The dead man's switch is not held, or silent."""
    if not settings.dead_mans_switch:
        return None
    stale = _stale("word from the dead man's switch", inputs.switch_age, settings.dead_mans_switch_age)
    return stale or (None if inputs.switch_held else "The dead man's switch is not held.")


def odometry_stale(inputs: SafetyInputs, settings: RuleSettings) -> str | None:
    """The odometry is too old."""
    return _stale("odometry", inputs.odometry_age, settings.odometry_age)


def localization_stale(inputs: SafetyInputs, settings: RuleSettings) -> str | None:
    """The word on the localization is too old."""
    return _stale("localization", inputs.localization_age, settings.localization_age)


def _too_far(what: str, value: float | None, unit: str, stop: float) -> str | None:
    if value is None:
        return f"The {what} since the last localization are unknown."
    return None if value <= stop else f"{value:.1f} {unit} since the last localization; the limit is {stop:.1f} {unit}."


def _rather_far(value: float | None, unit: str, slow: float, stop: float) -> str | None:
    if value is None or not slow < value <= stop:
        return None
    return f"{value:.1f} {unit} since the last localization; the robot slows down beyond {slow:.1f} {unit}."


def metres_stop(inputs: SafetyInputs, settings: RuleSettings) -> str | None:
    """Too many metres without a localization."""
    return _too_far("metres", inputs.metres_since_success, "m", settings.metres_stop)


def metres_slow(inputs: SafetyInputs, settings: RuleSettings) -> str | None:
    """Many metres without a localization."""
    return _rather_far(inputs.metres_since_success, "m", settings.metres_slow, settings.metres_stop)


def seconds_stop(inputs: SafetyInputs, settings: RuleSettings) -> str | None:
    """Too many seconds without a localization."""
    return _too_far("seconds", inputs.seconds_since_success, "s", settings.seconds_stop)


def seconds_slow(inputs: SafetyInputs, settings: RuleSettings) -> str | None:
    """Many seconds without a localization."""
    return _rather_far(inputs.seconds_since_success, "s", settings.seconds_slow, settings.seconds_stop)


def obstacles_stale(inputs: SafetyInputs, settings: RuleSettings) -> str | None:
    """The obstacle watch is silent."""
    if inputs.obstacles is None:
        return None
    return _stale("word from the obstacle watch", inputs.obstacles_age, settings.obstacles_age)


def obstacle_stop(inputs: SafetyInputs, _: RuleSettings) -> str | None:
    """Something is in the stop zone."""
    return "Something stands in the robot's way." if inputs.obstacles is Zone.STOP else None


def obstacle_slow(inputs: SafetyInputs, _: RuleSettings) -> str | None:
    """Something is in the slow zone."""
    return "Something stands near the robot's way; it slows down." if inputs.obstacles is Zone.SLOW else None


def path_offset(inputs: SafetyInputs, settings: RuleSettings) -> str | None:
    """The robot is too far beside the path."""
    if not inputs.metric:
        return None
    if inputs.path_offset is None:
        return "The offset from the path is unknown."
    if abs(inputs.path_offset) <= settings.path_offset:
        return None
    return f"The robot is {abs(inputs.path_offset):.2f} m off the path; the limit is {settings.path_offset:.2f} m."


def uncertain(inputs: SafetyInputs, settings: RuleSettings) -> str | None:
    """The covariance is too large, or none."""
    covariance = inputs.covariance
    if covariance is None or covariance.shape != (6, 6) or not np.isfinite(covariance).all():
        return "The covariance of the robot's pose is unknown or not finite."
    in_plane = covariance[:2, :2] if inputs.metric else covariance[:1, :1]
    least, *_, most = np.linalg.eigvalsh(in_plane)[[0, -1]].tolist()
    if not (least >= 0.0 and most < math.inf and covariance[5, 5] >= 0.0):
        return "The covariance of the robot's pose has a variance below zero, and so tells nothing."
    position, heading = math.sqrt(most), math.sqrt(float(covariance[5, 5]))
    what, limit = ("position", settings.position_sigma) if inputs.metric else ("distance", settings.distance_sigma)
    if position > limit:
        return f"The {what} is uncertain by {position:.2f} m (1 sigma); the limit is {limit:.2f} m."
    if heading > settings.heading_sigma:
        return (
            f"The heading is uncertain by {heading:.2f} rad (1 sigma); the limit is {settings.heading_sigma:.2f} rad."
        )
    return None
