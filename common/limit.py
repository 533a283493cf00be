"""How often the same is logged: an attacker decides how often it is tried."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Hashable

_KEPT = 256


class Limit:
    """Lets a thing pass once a period, and all things together so often a period."""

    def __init__(self, period: float, together: int) -> None:
        """``period`` in seconds."""
        self._period = period
        self._together = together
        self._last: OrderedDict[Hashable, float] = OrderedDict()
        self._silent: dict[Hashable, int] = {}
        self._begun = float("-inf")
        self._passed = 0

    def passes(self, thing: Hashable, now: float) -> int:
        """How often it has come since it last passed, this time included, if it passes now; else 0."""
        if now - self._begun >= self._period:
            self._begun, self._passed = now, 0
        count = self._silent.get(thing, 0) + 1
        if now - self._last.get(thing, float("-inf")) < self._period or self._passed >= self._together:
            if thing in self._silent or len(self._silent) < _KEPT:
                self._silent[thing] = count
            return 0
        self._passed += 1
        self._silent.pop(thing, None)
        self._last[thing] = now
        self._last.move_to_end(thing)
        if len(self._last) > _KEPT:
            self._last.popitem(last=False)
        return count
