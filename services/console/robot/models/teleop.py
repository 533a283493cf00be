"""The page's joystick: a dead man's switch that lets go by itself.

Nothing is sent but what a held joystick says at this moment. Whatever falls silent, comes late, or belongs to a second
browser moves nothing, and safety stops a robot that it hears no command for.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

LATE_S = 0.25
"""A command that was under way so much longer than the quickest one is of no use any more."""

HELD_S = 0.5
"""A browser that has been silent for so long has let go."""


@dataclass(frozen=True, slots=True)
class Velocity:
    """m/s forwards and rad/s to the left."""

    v: float
    w: float


@dataclass(slots=True)
class _Holder:
    browser: int
    heard: float
    quickest: float


class Teleop:
    """Who holds the joystick, and what of that is passed on."""

    def __init__(self, speed: float, turn_rate: float) -> None:
        self._speed, self._turn_rate = speed, turn_rate
        self._holder: _Holder | None = None

    def held(self, now: float) -> int | None:
        """The browser that drives, None where none does; ``now`` is monotonic, in seconds."""
        holder = self._holder
        return holder.browser if holder is not None and now - holder.heard <= HELD_S else None

    def take(self, browser: int, forwards: float, left: float, sent: float, now: float) -> Velocity | None:
        """What to send for a joystick at ``forwards`` and ``left``, each in [-1, 1]; None where nothing may be.

        ``sent`` is the browser's own clock in seconds: only its differences count.
        """
        if not all(map(math.isfinite, (forwards, left, sent))):
            return None
        other = self.held(now)
        if other is not None and other != browser:
            return None
        delay = now - sent
        if self._holder is None or other is None:
            self._holder = _Holder(browser, now, delay)
        holder = self._holder
        holder.quickest = min(holder.quickest, delay)
        if delay - holder.quickest > LATE_S:
            return None
        holder.heard = now
        return Velocity(_share(forwards) * self._speed, _share(left) * self._turn_rate)

    def release(self, browser: int) -> bool:
        """A browser lets go, or has gone; whether it was the one that drove."""
        if self._holder is None or self._holder.browser != browser:
            return False
        self._holder = None
        return True


def _share(value: float) -> float:
    return min(max(value, -1.0), 1.0)
