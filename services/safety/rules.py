"""When a command may pass: all rules, in one table; what each looks at is in :mod:`services.safety.checks`."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum

from common.messages import Zone
from services.safety import checks
from services.safety.inputs import CommandKind, SafetyInputs
from services.safety.limits import RuleSettings


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
    OBSTACLES_STALE = "obstacles_stale"
    OBSTACLE = "obstacle"
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


Check = Callable[[SafetyInputs, RuleSettings], str | None]


@dataclass(frozen=True, slots=True)
class Rule:
    """One rule: what it is called, what it does, the motion for which it is asked, its check, and when that objects.

    ``when`` is for the documentation; names in braces are those of :class:`RuleSettings`.
    """

    cause: Cause
    effect: Effect
    asked_for: frozenset[CommandKind | None]
    check: Check
    when: str


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
    left = 1.0 - max(metres, seconds) * (1.0 - settings.slowest)
    return min(left, settings.obstacle_slow) if inputs.obstacles is Zone.SLOW else left


def _share(value: float | None, slow: float, stop: float) -> float:
    """How far a value is on the way from ``slow`` to ``stop``, in [0, 1]; 1 for what is unknown."""
    if value is None or not value <= stop:
        return 1.0
    return max((value - slow) / (stop - slow), 0.0) if value > slow else 0.0


_ALWAYS: frozenset[CommandKind | None] = frozenset({None, CommandKind.TELEOP, CommandKind.DESIRED})
_NO_MOTION: frozenset[CommandKind | None] = frozenset({None})
_MOTION: frozenset[CommandKind | None] = frozenset({CommandKind.TELEOP, CommandKind.DESIRED})
_REPEATING: frozenset[CommandKind | None] = frozenset({CommandKind.DESIRED})

RULES: tuple[Rule, ...] = (
    Rule(Cause.EMERGENCY_STOP, Effect.EMERGENCY, _ALWAYS, checks.emergency_stop, "the emergency stop is latched"),
    Rule(Cause.REARMING, Effect.STOP, _ALWAYS, checks.rearming, "after its reset, until no command to move arrives"),
    Rule(Cause.STATE_UNKNOWN, Effect.STOP, _ALWAYS, checks.state_unknown, "no state, or one older than {state_age} s"),
    Rule(Cause.STATE_FORBIDS, Effect.STOP, _NO_MOTION, checks.state_forbids, "the state allows no motion"),
    Rule(
        Cause.COMMAND_STALE, Effect.STOP, _MOTION, checks.command_stale, "no command, or one older than {command_age} s"
    ),
    Rule(
        Cause.COMMAND_KIND, Effect.STOP, _MOTION, checks.command_kind, "a command from whom the state does not take it"
    ),
    Rule(Cause.COMMAND_INVALID, Effect.STOP, _MOTION, checks.command_invalid, "a command that is not finite, or huge"),
    Rule(Cause.SERVICE_MISSING, Effect.STOP, _MOTION, checks.service_missing, "a process that it needs is not present"),
    Rule(
        Cause.DEAD_MANS_SWITCH,
        Effect.STOP,
        _MOTION,
        checks.dead_mans_switch,
        "where configured: the switch is not held, or silent for {dead_mans_switch_age} s",
    ),
    Rule(
        Cause.ODOMETRY_STALE, Effect.STOP, _REPEATING, checks.odometry_stale, "no odometry of the last {odometry_age} s"
    ),
    Rule(
        Cause.LOCALIZATION_STALE,
        Effect.STOP,
        _REPEATING,
        checks.localization_stale,
        "no word on the localization on the route for {localization_age} s",
    ),
    Rule(
        Cause.METRES_UNLOCALIZED, Effect.STOP, _REPEATING, checks.metres_stop, "{metres_stop} m without a localization"
    ),
    Rule(
        Cause.METRES_UNLOCALIZED, Effect.SLOW, _REPEATING, checks.metres_slow, "{metres_slow} m without a localization"
    ),
    Rule(
        Cause.SECONDS_UNLOCALIZED,
        Effect.STOP,
        _REPEATING,
        checks.seconds_stop,
        "{seconds_stop} s without a localization",
    ),
    Rule(
        Cause.SECONDS_UNLOCALIZED,
        Effect.SLOW,
        _REPEATING,
        checks.seconds_slow,
        "{seconds_slow} s without a localization",
    ),
    Rule(
        Cause.OBSTACLES_STALE,
        Effect.STOP,
        _REPEATING,
        checks.obstacles_stale,
        "where obstacles are watched for: no word for {obstacles_age} s",
    ),
    Rule(Cause.OBSTACLE, Effect.STOP, _REPEATING, checks.obstacle_stop, "something in the stop zone, that way"),
    Rule(Cause.OBSTACLE, Effect.SLOW, _REPEATING, checks.obstacle_slow, "something in the slow zone, that way"),
    Rule(Cause.PATH_OFFSET, Effect.STOP, _REPEATING, checks.path_offset, "more than {path_offset} m beside the path"),
    Rule(
        Cause.UNCERTAIN,
        Effect.STOP,
        _REPEATING,
        checks.uncertain,
        "one sigma of more than {position_sigma} m across, {distance_sigma} m along a route by bearing, "
        "or {heading_sigma} rad",
    ),
)
"""Every rule, the gravest first. The safety page of the documentation is drawn from it."""
