"""Waits for the end of a repeat, with its progress on standard error."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

from cli.errors import CommandError
from cli.output import progress
from common import topics
from common.bus import Bus
from common.messages import Done, State, StateName, TrackerStatus

if TYPE_CHECKING:
    from rich.progress import Progress, TaskID

REACHED = "reached"
"""How the navigator's reason begins when a repeat ended at its goal."""

_REPEATING = {StateName.REPEAT_PLAN, StateName.REPEAT_METRIC_LOCALIZE, StateName.REPEAT_FOLLOW}
_BEGIN_DEADLINE_S = 5.0
_SILENCE_S = 5.0
_POLL_S = 0.2


class RepeatWatch:
    """Follows the states of a repeat; made before the order is sent, so that it misses none."""

    def __init__(self, bus: Bus) -> None:
        self._states = bus.subscribe(topics.STATE)
        self._tracker = bus.subscribe(topics.TRACKER_STATUS)

    def until_done(self) -> Done:
        """Waits until the robot has reached its goal; while it is paused, until it is resumed and has.

        Raises:
            CommandError: the repeat ended elsewhere, never began, or nothing is heard of it any more.
        """
        begun = False
        start = heard = time.monotonic()
        with progress() as display:
            task = display.add_task("waiting for the repeat to begin", total=None)
            while True:
                received = self._states.wait(_POLL_S)
                now = time.monotonic()
                if received is None:
                    if now - heard > _SILENCE_S:
                        raise CommandError("the navigator is silent: vtr ps tells whether it runs")
                    continue
                heard, state = now, received.message
                begun = begun or state.name in _REPEATING
                if state.name is StateName.IDLE and begun:
                    return _ended(state)
                if not begun and now - start > _BEGIN_DEADLINE_S:
                    raise CommandError(f"the repeat did not begin: {state.reason or state.name}")
                self._show(display, task, state)

    def _show(self, display: Progress, task: TaskID, state: State) -> None:
        status: TrackerStatus | None = self._tracker.fresh()
        text = state.waiting_for or state.reason if state.name is not StateName.REPEAT_FOLLOW else "metres"
        display.update(task, description=f"{state.name}: {text}")
        if status is not None and status.route == state.route:
            display.update(
                task, completed=round(status.arclength, 1), total=round(status.arclength + status.remaining, 1)
            )


def _ended(state: State) -> Done:
    if not state.reason.lower().startswith(REACHED):
        raise CommandError(f"the repeat ended before its goal: {state.reason or 'no reason is known'}")
    return Done(text=state.reason)
