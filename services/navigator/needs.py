"""What each state needs: processes that must be there, and data that must keep coming."""

from __future__ import annotations

from collections.abc import Collection, Mapping

from common.messages import StateName

_TEACH = ("sensors", "estimator", "mapstore", "safety")
_REPEAT = ("sensors", "estimator", "tracker", "safety")

PROCESSES: Mapping[StateName, tuple[str, ...]] = {
    StateName.TEACH_METRIC_LOCALIZE: _TEACH,
    StateName.TEACH_BRANCH: _TEACH,
    StateName.TEACH_MERGE: _TEACH,
    StateName.REPEAT_PLAN: (*_REPEAT, "mapstore", "planner"),
    StateName.REPEAT_METRIC_LOCALIZE: (*_REPEAT, "mapstore"),
    # The submaps ahead are fetched before they are needed, so following goes on for a while without the store.
    StateName.REPEAT_FOLLOW: _REPEAT,
}
"""Processes by state; Idle and Paused need none."""

DATA: Mapping[StateName, tuple[str, ...]] = {
    StateName.TEACH_BRANCH: ("odometry",),
    StateName.TEACH_MERGE: ("odometry",),
    StateName.REPEAT_FOLLOW: ("odometry", "localization", "tracker/status"),
}
"""Topics whose silence ends the state. A state that waits for data has a deadline instead."""

_STANDS_IN = {"sensors": "player"}
"""A process that does another's work while it is there."""


def missing(state: StateName, present: Collection[str]) -> tuple[str, ...]:
    """The processes that a state needs and that are not present."""
    return tuple(
        name
        for name in PROCESSES.get(state, ())
        if name not in present and _STANDS_IN.get(name) not in present
    )  # fmt: skip


def silent(
    state: StateName, since: float, now: float, arrivals: Mapping[str, float], first_s: float, gap_s: float
) -> tuple[str, ...]:
    """The topics that a state needs and that have been silent for too long.

    ``arrivals`` holds the monotonic time (s) of each topic's last sample, ``since`` is when the state was entered. What
    flowed then may have gaps of ``gap_s``; what did not may take ``first_s`` to begin.
    """

    def is_silent(topic: str) -> bool:
        arrival = arrivals.get(topic, float("-inf"))
        flows = since - arrival <= gap_s
        return now - max(arrival, since) > (gap_s if flows else first_s)

    return tuple(topic for topic in DATA.get(state, ()) if is_silent(topic))


def listed(names: Collection[str]) -> str:
    """Names in a sentence: ``a``, ``a and b``, ``a, b and c``."""
    *most, last = names
    return f"{', '.join(most)} and {last}" if most else last
