"""One cycle of safety: ask the rules, then let the command through, slow it, ramp it down or stop at once."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

from common import topics
from services.safety.inputs import SafetyInputs, VelocityCommand
from services.safety.limits import RuleSettings
from services.safety.ramp import Ramp, RampSettings
from services.safety.rules import Effect, Reason, evaluate


@dataclass(frozen=True, slots=True)
class SafetySettings:
    """Everything safety can be told, in seconds.

    ``period`` is that of its loop; ``base_timeout`` after the last command the base has stopped by itself.
    """

    rules: RuleSettings = field(default_factory=RuleSettings)
    ramp: RampSettings = field(default_factory=RampSettings)
    period: float = 0.02
    base_timeout: float = topics.SAFE.max_age_s


@dataclass(frozen=True, slots=True)
class SafetyOutput:
    """The base's command (m/s, rad/s), every reason that slows or stops it, and the share of the speed limit left."""

    v: float
    w: float
    reasons: tuple[Reason, ...]
    scale: float


class SafetyMonitor:
    """Decides, once a period, what the base is told. Not thread-safe; knows no clock and no bus."""

    def __init__(self, settings: SafetySettings | None = None) -> None:
        self._settings = settings or SafetySettings()
        self._ramp = Ramp(self._settings.ramp)
        self._last: float | None = None
        self._rearming = False
        self._released: float | None = None

    def step(self, now: float, inputs: SafetyInputs) -> SafetyOutput:
        """The output at ``now``, seconds of the monotonic clock."""
        inputs = self._rearm(now, inputs)
        verdict = evaluate(inputs, self._settings.rules)
        seconds = self._elapsed(now)
        if verdict.effect is Effect.EMERGENCY:
            v, w = self._ramp.halt()
        elif verdict.effect is Effect.STOP or inputs.command is None:
            v, w = self._ramp.brake(seconds)
        else:
            v, w = self._ramp.follow(inputs.command.v, inputs.command.w, seconds, verdict.scale)
        return SafetyOutput(v, w, verdict.reasons, verdict.scale)

    def _elapsed(self, now: float) -> float:
        """Seconds since the last cycle; a loop that hung may not make up for it by a jump in speed.

        Where it hung for so long that the base has stopped, the robot starts from rest.
        """
        elapsed = self._settings.period if self._last is None else now - self._last
        self._last = now
        if elapsed > self._settings.base_timeout:
            self._ramp.halt()
        return min(max(elapsed, 0.0), 2.0 * self._settings.period)

    def _rearm(self, now: float, inputs: SafetyInputs) -> SafetyInputs:
        """After an emergency stop, hold the robot until a moment without any command to move has passed.

        Otherwise a tracker, or a stick, that never let go would drive off the moment somebody resets the latch. A
        command from before that moment does not count either.
        """
        if inputs.estop is not None:
            self._rearming, self._released = True, None
            return inputs
        if self._rearming and self._neutral(inputs):
            self._rearming, self._released = False, now
        command = inputs.command
        if self._released is not None and command is not None and now - command.age <= self._released:
            command = None
        return replace(inputs, rearming=self._rearming, command=command)

    def _neutral(self, inputs: SafetyInputs) -> bool:
        """Whether nothing asks the robot to move, or could."""
        command: VelocityCommand | None = inputs.command
        if inputs.motion is None or command is None or not command.age <= self._settings.rules.command_age:
            return True
        return command.v == 0.0 and command.w == 0.0
