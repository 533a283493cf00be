"""The last stage before the base: whatever comes in, what goes out is within the limits of the vehicle."""

from __future__ import annotations

import math
from dataclasses import dataclass


class LimitError(ValueError):
    """A limit that is not positive and finite."""


@dataclass(frozen=True, slots=True)
class RampSettings:
    """Hard limits of the vehicle: m/s, rad/s, m/s^2, rad/s^2.

    They are wider than the tracker's own, so that safety clips only what should not have been asked for. From 1.2 m/s
    ``deceleration`` stops within 0.3 s, so that the robot stands half a second after it has lost a process it needs.
    """

    speed: float = 1.5
    turn_rate: float = 1.5
    acceleration: float = 1.0
    deceleration: float = 4.0
    turn_acceleration: float = 3.0

    def __post_init__(self) -> None:
        """Refuse what no vehicle can have."""
        for name in self.__slots__:
            if not 0.0 < getattr(self, name) < math.inf:
                raise LimitError(f"The limit `{name}` is {getattr(self, name)}; it must be positive and finite.")


class Ramp:
    """Holds the command that goes out and moves it towards the one that is wanted. Starts at rest."""

    def __init__(self, settings: RampSettings | None = None) -> None:
        self._settings = settings or RampSettings()
        self._v, self._w = 0.0, 0.0

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
        self._v = _towards(self._v, v, limits.acceleration * seconds, limits.deceleration * seconds)
        change = limits.turn_acceleration * seconds
        self._w = _towards(self._w, w, change, change)
        return self.command

    def brake(self, seconds: float) -> tuple[float, float]:
        """Towards rest on the same arc: ``v / w`` stays.

        At rest after ``max(|v| / deceleration, |w| / turn_acceleration)`` seconds.
        """
        limits = self._settings
        needed = max(abs(self._v) / limits.deceleration, abs(self._w) / limits.turn_acceleration)
        keep = 1.0 - seconds / needed if seconds < needed else 0.0
        self._v, self._w = self._v * keep, self._w * keep
        return self.command

    def halt(self) -> tuple[float, float]:
        """At rest at once."""
        self._v, self._w = 0.0, 0.0
        return self.command


def _on_the_same_arc(v: float, w: float, speed: float, turn_rate: float) -> tuple[float, float]:
    """The command scaled down to where both limits hold."""
    share = min(1.0, *(limit / abs(value) for value, limit in ((v, speed), (w, turn_rate)) if abs(value) > limit), 1.0)
    v, w = v * share, w * share
    # Huge values leave a rounding error; the limits are hard.
    return min(max(v, -speed), speed), min(max(w, -turn_rate), turn_rate)


def _towards(now: float, wanted: float, faster: float, slower: float) -> float:
    """``now`` moved to ``wanted`` by at most ``faster`` away from zero or ``slower`` towards it, not across zero."""
    if now * wanted < 0.0:
        wanted = 0.0
    most = faster if abs(wanted) > abs(now) else slower
    return now + min(max(wanted - now, -most), most)
