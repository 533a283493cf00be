"""When a velocity command goes to the base, and when none does."""

from __future__ import annotations

from dataclasses import dataclass

_STOPS_S = 1.0
_STOP_PERIOD_S = 0.05


@dataclass(slots=True)
class CommandGate:
    """Passes ``command/safe`` on while it is fresh.

    When it falls silent the base is told to stop for a second, and then nothing, so that a person may drive it.

    Attributes:
        max_age_s: an older command does not pass.
    """

    max_age_s: float
    _heard: float | None = None
    _sent: float = float("-inf")

    def fresh(self, arrival: float, now: float) -> bool:
        """Whether a command that arrived then may pass now; monotonic seconds."""
        if now - arrival > self.max_age_s:
            return False
        self._heard, self._sent = arrival, now
        return True

    def stops(self, now: float) -> bool:
        """Whether the base is to be told to stop now, for the commands have fallen silent."""
        if self._heard is None or now - self._heard <= self.max_age_s or now - self._sent < _STOP_PERIOD_S:
            return False
        if now - self._heard > self.max_age_s + _STOPS_S:
            self._heard = None
            return False
        self._sent = now
        return True
