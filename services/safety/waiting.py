"""What waited while this process did not run: an arrival tells an age only where somebody was there to see it."""

from __future__ import annotations

_DRAIN_S = 0.1
"""Samples that were queued during a hang have all been handed over this long after it."""


class Waiting:
    """Finds the hangs of a loop, and how much older than their arrival samples may be."""

    def __init__(self, period: float) -> None:
        """``period``: of the loop, seconds; a cycle that is later than three of it was a hang."""
        self._period = period
        self._last: float | None = None
        self._begin = self._end = self._seconds = 0.0

    def cycle(self, now: float) -> None:
        """A cycle of the loop begins at ``now``, seconds of the monotonic clock."""
        last, self._last = self._last, now
        if last is not None and now - last > 3.0 * self._period:
            self._begin, self._end, self._seconds = last, now + _DRAIN_S, now - last

    def seconds(self, arrival: float) -> float:
        """How long a sample that arrived at this monotonic time may have waited before."""
        return self._seconds if self._begin < arrival < self._end else 0.0
