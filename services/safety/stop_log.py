"""A line in the log when the robot is stopped, and why, and one when commands pass again."""

from __future__ import annotations

from collections.abc import Sequence

import structlog

from services.safety.rules import Effect, Reason

_PERIOD_S = 1.0

log = structlog.get_logger()


class StopLog:
    """Hears of each cycle; where stops follow one another closely, writes once a second."""

    def __init__(self) -> None:
        self._told: tuple[str, ...] | None = None
        self._due = 0.0

    def cycle(self, now: float, reasons: Sequence[Reason], *, passing: bool) -> None:
        """``now`` is in seconds of the monotonic clock."""
        causes = () if passing else tuple(reason.cause.value for reason in reasons if reason.effect is not Effect.SLOW)
        if causes == self._told or now < self._due:
            return
        self._told, self._due = causes, now + _PERIOD_S
        if causes:
            log.info("the robot is stopped", reasons=[reason.sentence for reason in reasons])
        elif passing:
            log.info("commands pass")
