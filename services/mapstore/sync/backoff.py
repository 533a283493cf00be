"""When to try again: exponential back-off with full jitter, so that a fleet does not come back all at once."""

from __future__ import annotations

import random
from dataclasses import dataclass, field

_FIRST_S = 1.0


@dataclass(slots=True)
class Backoff:
    """The pauses after failures in a row; each is drawn evenly from zero to twice the last one's bound.

    Attributes:
        most_s: longest pause, seconds.
        failures: in a row.
    """

    most_s: float
    failures: int = 0
    chance: random.Random = field(default_factory=random.Random)

    def failed(self) -> float:
        """Seconds until the next try."""
        self.failures += 1
        bound = min(self.most_s, _FIRST_S * 2.0 ** min(self.failures, 30))
        return self.chance.uniform(0.0, bound)

    def worked(self) -> None:
        """Begins anew."""
        self.failures = 0
