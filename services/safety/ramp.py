"""The last stage before the base: whatever comes in, what goes out is within the limits of the vehicle."""

from __future__ import annotations

import math
from dataclasses import dataclass


class LimitError(ValueError):
    """A limit that is not positive and finite."""


@dataclass(frozen=True, slots=True)
class RampSettings:
    """Hard limits of the vehicle, wider than the tracker's own: safety clips only what should not have been asked for.

    Where a rule stops the robot the deceleration is there at once: then time counts, and not comfort.

    Attributes:
        speed: m/s.
        turn_rate: rad/s.
        acceleration: m/s^2.
        deceleration: m/s^2. From 1.2 m/s the default stops within 0.24 s, so that the robot stands half a second after
            it has lost a process that it needs.
        turn_acceleration: rad/s^2.
        jerk: how the acceleration of a command that passes may grow, m/s^3.
        braking_jerk: how its deceleration may grow, m/s^3.
        turn_jerk: how the acceleration of a turn may grow, rad/s^3.
    """

    speed: float = 1.5
    turn_rate: float = 1.5
    acceleration: float = 1.0
    deceleration: float = 5.0
    turn_acceleration: float = 3.0
    jerk: float = 10.0
    braking_jerk: float = 60.0
    turn_jerk: float = 60.0

    def __post_init__(self) -> None:
        """Refuse what no vehicle can have."""
        for name in self.__slots__:
            if not 0.0 < getattr(self, name) < math.inf:
                raise LimitError(f"The limit `{name}` is {getattr(self, name)}; it must be positive and finite.")


@dataclass(frozen=True, slots=True)
class _Axis:
    """The limits of the speed, or of the turn rate."""

    faster: float
    slower: float
    jerk: float
    braking_jerk: float


class Ramp:
    """Holds the command that goes out and moves it towards the one that is wanted. Starts at rest."""

    def __init__(self, settings: RampSettings | None = None) -> None:
        self._settings = settings or RampSettings()
        self._v, self._w = 0.0, 0.0
        self._rates = 0.0, 0.0
        limits = self._settings
        self._along = _Axis(limits.acceleration, limits.deceleration, limits.jerk, limits.braking_jerk)
        turns = limits.turn_acceleration, limits.turn_acceleration
        self._turning = _Axis(*turns, limits.turn_jerk, limits.turn_jerk)

    @property
    def command(self) -> tuple[float, float]:
        """The last command: m/s, rad/s."""
        return self._v, self._w

    def follow(self, v: float, w: float, seconds: float, scale: float = 1.0) -> tuple[float, float]:
        """Towards a wanted command, at no more than ``scale``, 0 to 1, of the greatest speed; brakes for NaN.

        A command that is too fast is scaled as a whole, so that the robot drives the arc that was meant.
        """
        if not (math.isfinite(v) and math.isfinite(w)):
            return self.brake(seconds)
        limits = self._settings
        v, w = _on_the_same_arc(v, w, limits.speed * min(max(scale, 0.0), 1.0), limits.turn_rate)
        before = self.command
        self._v = _within(_towards(self._v, v, self._rates[0], self._along, seconds), limits.speed)
        self._w = _within(_towards(self._w, w, self._rates[1], self._turning, seconds), limits.turn_rate)
        if seconds > 0.0:
            self._rates = (self._v - before[0]) / seconds, (self._w - before[1]) / seconds
        return self.command

    def brake(self, seconds: float) -> tuple[float, float]:
        """Towards rest on the same arc: ``v / w`` stays.

        At rest after ``max(|v| / deceleration, |w| / turn_acceleration)`` seconds.
        """
        limits = self._settings
        needed = max(abs(self._v) / limits.deceleration, abs(self._w) / limits.turn_acceleration)
        keep = 1.0 - seconds / needed if seconds < needed else 0.0
        self._v, self._w = self._v * keep, self._w * keep
        self._rates = 0.0, 0.0
        return self.command

    def halt(self) -> tuple[float, float]:
        """At rest at once."""
        self._v, self._w = 0.0, 0.0
        self._rates = 0.0, 0.0
        return self.command


def _on_the_same_arc(v: float, w: float, speed: float, turn_rate: float) -> tuple[float, float]:
    """The command scaled down to where both limits hold."""
    share = min(1.0, *(limit / abs(value) for value, limit in ((v, speed), (w, turn_rate)) if abs(value) > limit), 1.0)
    v, w = v * share, w * share
    # Huge values leave a rounding error; the limits are hard.
    return _within(v, speed), _within(w, turn_rate)


def _within(value: float, limit: float) -> float:
    return min(max(value, -limit), limit)


def _towards(now: float, wanted: float, rate: float, axis: _Axis, seconds: float) -> float:
    """``now`` moved to ``wanted`` within the limits, not across zero; ``rate`` is how fast it has changed so far.

    The change ebbs away before the wanted value: from a rate ``a`` on, ``a dt + a^2 / (2 jerk)`` is still to come.
    """
    if now * wanted < 0.0:
        wanted = 0.0
    left = wanted - now
    if left == 0.0 or seconds <= 0.0:
        return now
    speeds_up = abs(wanted) > abs(now)
    most, jerk = (axis.faster, axis.jerk) if speeds_up else (axis.slower, axis.braking_jerk)
    ebbing = jerk * (math.sqrt(seconds**2 + 2.0 * abs(left) / jerk) - seconds)
    # What still changes the other way, braking above all, is let go of sooner than new speed is gathered.
    step = (axis.braking_jerk if rate * left < 0.0 else jerk) * seconds
    if abs(left) <= 0.5 * jerk * seconds**2 and abs(left / seconds - rate) <= step:
        return wanted
    change = min(max(math.copysign(min(most, ebbing), left), rate - step), rate + step)
    after = now + change * seconds
    if (after - wanted) * left > 0.0:
        return wanted
    return 0.0 if after * now < 0.0 else after
