"""Keeps what comes faster down to a rate."""

from __future__ import annotations


class Pace:
    """Lets through what comes at a rate, evenly, and all of what comes no faster.

    What comes up to half a period early passes, so that a sensor of that very rate loses nothing to jitter; the
    schedule does not move for it, so that the mean is kept.
    """

    def __init__(self, rate: float) -> None:
        """Of a rate, Hz."""
        self._period = 1.0 / rate
        self._due = float("-inf")

    def lets(self, now: float) -> bool:
        """Whether what came at ``now``, monotonic seconds, passes."""
        if now < self._due - 0.5 * self._period:
            return False
        self._due = max(self._due + self._period, now)
        return True
