"""When a command may pass: one small function a rule, all in one table.

A rule looks at what is known and returns a sentence where it objects. Ages are seconds of the monotonic clock since
the local arrival; None stands for what never arrived. Every comparison is written so that NaN objects.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class CommandKind(StrEnum):
    """Where a velocity command comes from."""

    DESIRED = "desired"
    """The tracker, while a route is repeated."""
    TELEOP = "teleop"
    """The operator."""


MOTION_OF_STATE: dict[str, CommandKind] = {
    "teach.metric_localize": CommandKind.TELEOP,
    "teach.branch": CommandKind.TELEOP,
    "teach.merge": CommandKind.TELEOP,
    "repeat.follow": CommandKind.DESIRED,
}
"""The kind of command that each state lets through; a state that is not here lets none through."""


class Cause(StrEnum):
    """Why safety stops the robot or slows it down."""

    EMERGENCY_STOP = "emergency_stop"
    REARMING = "rearming"
    STATE_UNKNOWN = "state_unknown"
    STATE_FORBIDS = "state_forbids"
    COMMAND_STALE = "command_stale"
    COMMAND_KIND = "command_kind"
    COMMAND_INVALID = "command_invalid"
    SERVICE_MISSING = "service_missing"
    DEAD_MANS_SWITCH = "dead_mans_switch"
    ODOMETRY_STALE = "odometry_stale"
    LOCALIZATION_STALE = "localization_stale"
    METRES_UNLOCALIZED = "metres_unlocalized"
    SECONDS_UNLOCALIZED = "seconds_unlocalized"
    PATH_OFFSET = "path_offset"
    UNCERTAIN = "uncertain"


class Effect(StrEnum):
    """What a reason does to the robot."""

    SLOW = "slow"
    STOP = "stop"
    EMERGENCY = "emergency"


@dataclass(frozen=True, slots=True)
class Reason:
    """Why the robot is slowed or stopped: its cause, for programs, and one sentence, for people."""

    cause: Cause
    effect: Effect
    sentence: str


@dataclass(frozen=True, slots=True)
class RuleSettings:
    """Limits of the rules: ages in seconds, distances in metres, angles in radians.

    The speed falls from its full limit at ``*_slow`` to ``slowest`` of it at ``*_stop``, beyond which the robot stops.
    ``position_sigma`` bounds a metric position, ``distance_sigma`` the distance along a route by bearing alone.
    """

    command_age: float = 0.25
    state_age: float = 0.5
    odometry_age: float = 0.5
    localization_age: float = 0.5
    dead_mans_switch: bool = False
    dead_mans_switch_age: float = 0.3
    metres_slow: float = 3.0
    metres_stop: float = 10.0
    seconds_slow: float = 3.0
    seconds_stop: float = 10.0
    slowest: float = 0.3
    path_offset: float = 0.8
    position_sigma: float = 0.5
    distance_sigma: float = 1.2
    heading_sigma: float = 0.35


@dataclass(frozen=True, slots=True)
class VelocityCommand:
    """A command as it arrived: m/s forwards, rad/s to the left, where from, and how old."""

    v: float
    w: float
    kind: CommandKind
    age: float


@dataclass(frozen=True, slots=True)
class SafetyInputs:
    """Everything that safety knows in one cycle.

    ``state`` is dotted, as in ``repeat.follow``. ``localization_age`` is that of the last word from the estimator;
    ``metres_since_success`` and ``seconds_since_success`` are what that word said, the latter brought up to now.
    ``covariance`` (6, 6) is that of ``T_trunk_robot``, translation first; where the localization is not ``metric``,
    only the distance along the route (x) and the heading are measured, and only they are judged. ``estop`` is why the
    emergency stop is latched, None where it is not. ``missing`` names the needed services that are not present.
    ``rearming`` is set by the monitor after an emergency stop, until a moment without a command to move has passed.
    """

    state: str | None = None
    state_age: float | None = None
    command: VelocityCommand | None = None
    odometry_age: float | None = None
    localization_age: float | None = None
    switch_held: bool = False
    switch_age: float | None = None
    metres_since_success: float | None = None
    seconds_since_success: float | None = None
    path_offset: float | None = None
    covariance: Array | None = None
    metric: bool = True
    estop: str | None = None
    missing: tuple[str, ...] = field(default=())
    rearming: bool = False

    @property
    def motion(self) -> CommandKind | None:
        """The kind of command that the state lets through."""
        return MOTION_OF_STATE.get(self.state) if self.state is not None else None


Check = Callable[[SafetyInputs, RuleSettings], str | None]


@dataclass(frozen=True, slots=True)
class Rule:
    """One rule: what it is called, what it does, the motion for which it is asked, and its check."""

    cause: Cause
    effect: Effect
    asked_for: frozenset[CommandKind | None]
    check: Check


@dataclass(frozen=True, slots=True)
class Verdict:
    """All reasons, in the order of the table, and the share of the speed limit that they leave, 0 to 1."""

    reasons: tuple[Reason, ...]
    scale: float

    @property
    def effect(self) -> Effect | None:
        """The strongest effect of all reasons."""
        effects = {reason.effect for reason in self.reasons}
        return next((effect for effect in (Effect.EMERGENCY, Effect.STOP, Effect.SLOW) if effect in effects), None)


def evaluate(inputs: SafetyInputs, settings: RuleSettings) -> Verdict:
    """Ask every rule of the table."""
    reasons = []
    for rule in RULES:
        if inputs.motion in rule.asked_for:
            sentence = rule.check(inputs, settings)
            if sentence is not None:
                reasons.append(Reason(rule.cause, rule.effect, sentence))
    if any(reason.effect is not Effect.SLOW for reason in reasons):
        return Verdict(tuple(reasons), 0.0)
    return Verdict(tuple(reasons), _scale(inputs, settings) if inputs.motion is CommandKind.DESIRED else 1.0)


def _scale(inputs: SafetyInputs, settings: RuleSettings) -> float:
    """The share of the speed limit that the time and way since the last success leave."""
    metres = _share(inputs.metres_since_success, settings.metres_slow, settings.metres_stop)
    seconds = _share(inputs.seconds_since_success, settings.seconds_slow, settings.seconds_stop)
    return 1.0 - max(metres, seconds) * (1.0 - settings.slowest)


def _share(value: float | None, slow: float, stop: float) -> float:
    """How far a value is on the way from ``slow`` to ``stop``, in [0, 1]; 1 for what is unknown."""
    if value is None or not value <= stop:
        return 1.0
    return max((value - slow) / (stop - slow), 0.0) if value > slow else 0.0


def _stale(what: str, age: float | None, limit: float) -> str | None:
    if age is None:
        return f"No {what} has arrived."
    return None if age <= limit else f"The last {what} is {age:.2f} s old; the limit is {limit:.2f} s."


def _emergency_stop(inputs: SafetyInputs, _: RuleSettings) -> str | None:
    return None if inputs.estop is None else f"The emergency stop is latched: {inputs.estop}"


def _rearming(inputs: SafetyInputs, _: RuleSettings) -> str | None:
    return "After an emergency stop the robot waits until no command to move arrives." if inputs.rearming else None


def _state_unknown(inputs: SafetyInputs, settings: RuleSettings) -> str | None:
    return _stale("state", None if inputs.state is None else inputs.state_age, settings.state_age)


def _state_forbids(inputs: SafetyInputs, _: RuleSettings) -> str | None:
    return None if inputs.state is None else f"The state {inputs.state} allows no motion."


def _command_stale(inputs: SafetyInputs, settings: RuleSettings) -> str | None:
    return _stale("command", None if inputs.command is None else inputs.command.age, settings.command_age)


def _command_kind(inputs: SafetyInputs, _: RuleSettings) -> str | None:
    if inputs.command is None or inputs.command.kind is inputs.motion:
        return None
    return f"The state {inputs.state} takes {inputs.motion} commands only, and this one is {inputs.command.kind}."


def _command_invalid(inputs: SafetyInputs, _: RuleSettings) -> str | None:
    command = inputs.command
    if command is None or (math.isfinite(command.v) and math.isfinite(command.w)):
        return None
    return f"The command ({command.v} m/s, {command.w} rad/s) is not finite."


def _service_missing(inputs: SafetyInputs, _: RuleSettings) -> str | None:
    return f"A needed service is not present: {', '.join(inputs.missing)}." if inputs.missing else None


def _dead_mans_switch(inputs: SafetyInputs, settings: RuleSettings) -> str | None:
    if not settings.dead_mans_switch:
        return None
    stale = _stale("word from the dead man's switch", inputs.switch_age, settings.dead_mans_switch_age)
    return stale or (None if inputs.switch_held else "The dead man's switch is not held.")


def _odometry_stale(inputs: SafetyInputs, settings: RuleSettings) -> str | None:
    return _stale("odometry", inputs.odometry_age, settings.odometry_age)


def _localization_stale(inputs: SafetyInputs, settings: RuleSettings) -> str | None:
    return _stale("localization", inputs.localization_age, settings.localization_age)


def _too_far(what: str, value: float | None, unit: str, stop: float) -> str | None:
    if value is None:
        return f"The {what} since the last localization are unknown."
    return None if value <= stop else f"{value:.1f} {unit} since the last localization; the limit is {stop:.1f} {unit}."


def _rather_far(value: float | None, unit: str, slow: float, stop: float) -> str | None:
    if value is None or not slow < value <= stop:
        return None
    return f"{value:.1f} {unit} since the last localization; the robot slows down beyond {slow:.1f} {unit}."


def _metres_stop(inputs: SafetyInputs, settings: RuleSettings) -> str | None:
    return _too_far("metres", inputs.metres_since_success, "m", settings.metres_stop)


def _metres_slow(inputs: SafetyInputs, settings: RuleSettings) -> str | None:
    return _rather_far(inputs.metres_since_success, "m", settings.metres_slow, settings.metres_stop)


def _seconds_stop(inputs: SafetyInputs, settings: RuleSettings) -> str | None:
    return _too_far("seconds", inputs.seconds_since_success, "s", settings.seconds_stop)


def _seconds_slow(inputs: SafetyInputs, settings: RuleSettings) -> str | None:
    return _rather_far(inputs.seconds_since_success, "s", settings.seconds_slow, settings.seconds_stop)


def _path_offset(inputs: SafetyInputs, settings: RuleSettings) -> str | None:
    if not inputs.metric:
        return None
    if inputs.path_offset is None:
        return "The offset from the path is unknown."
    if abs(inputs.path_offset) <= settings.path_offset:
        return None
    return f"The robot is {abs(inputs.path_offset):.2f} m off the path; the limit is {settings.path_offset:.2f} m."


def _uncertain(inputs: SafetyInputs, settings: RuleSettings) -> str | None:
    covariance = inputs.covariance
    if covariance is None or covariance.shape != (6, 6) or not np.isfinite(covariance).all():
        return "The covariance of the robot's pose is unknown or not finite."
    in_plane = covariance[:2, :2] if inputs.metric else covariance[:1, :1]
    variance = float(np.linalg.eigvalsh(in_plane)[-1])
    position, heading = math.sqrt(max(variance, 0.0)), math.sqrt(max(float(covariance[5, 5]), 0.0))
    what, limit = ("position", settings.position_sigma) if inputs.metric else ("distance", settings.distance_sigma)
    if position > limit:
        return f"The {what} is uncertain by {position:.2f} m (1 sigma); the limit is {limit:.2f} m."
    if heading > settings.heading_sigma:
        return (
            f"The heading is uncertain by {heading:.2f} rad (1 sigma); the limit is {settings.heading_sigma:.2f} rad."
        )
    return None


_ALWAYS: frozenset[CommandKind | None] = frozenset({None, CommandKind.TELEOP, CommandKind.DESIRED})
_NO_MOTION: frozenset[CommandKind | None] = frozenset({None})
_MOTION: frozenset[CommandKind | None] = frozenset({CommandKind.TELEOP, CommandKind.DESIRED})
_REPEATING: frozenset[CommandKind | None] = frozenset({CommandKind.DESIRED})

RULES: tuple[Rule, ...] = (
    Rule(Cause.EMERGENCY_STOP, Effect.EMERGENCY, _ALWAYS, _emergency_stop),
    Rule(Cause.REARMING, Effect.STOP, _ALWAYS, _rearming),
    Rule(Cause.STATE_UNKNOWN, Effect.STOP, _ALWAYS, _state_unknown),
    Rule(Cause.STATE_FORBIDS, Effect.STOP, _NO_MOTION, _state_forbids),
    Rule(Cause.COMMAND_STALE, Effect.STOP, _MOTION, _command_stale),
    Rule(Cause.COMMAND_KIND, Effect.STOP, _MOTION, _command_kind),
    Rule(Cause.COMMAND_INVALID, Effect.STOP, _MOTION, _command_invalid),
    Rule(Cause.SERVICE_MISSING, Effect.STOP, _MOTION, _service_missing),
    Rule(Cause.DEAD_MANS_SWITCH, Effect.STOP, _MOTION, _dead_mans_switch),
    Rule(Cause.ODOMETRY_STALE, Effect.STOP, _REPEATING, _odometry_stale),
    Rule(Cause.LOCALIZATION_STALE, Effect.STOP, _REPEATING, _localization_stale),
    Rule(Cause.METRES_UNLOCALIZED, Effect.STOP, _REPEATING, _metres_stop),
    Rule(Cause.METRES_UNLOCALIZED, Effect.SLOW, _REPEATING, _metres_slow),
    Rule(Cause.SECONDS_UNLOCALIZED, Effect.STOP, _REPEATING, _seconds_stop),
    Rule(Cause.SECONDS_UNLOCALIZED, Effect.SLOW, _REPEATING, _seconds_slow),
    Rule(Cause.PATH_OFFSET, Effect.STOP, _REPEATING, _path_offset),
    Rule(Cause.UNCERTAIN, Effect.STOP, _REPEATING, _uncertain),
)
"""Every rule, the gravest first. The safety page of the documentation is drawn from it."""
