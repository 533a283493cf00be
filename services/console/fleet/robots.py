"""The fleet's robots: who is connected and what each does, and what it has shared."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from common import messages as m
from common.topics import FLEET
from services.console.fleet.labels import robot_of

_NS_PER_HOUR = 3.6e12
_VISITORS = frozenset({"operator", "player", "observer", "recorder"})
"""Sessions that come and go, and do not make a robot connected."""


@dataclass(frozen=True, slots=True)
class Connected:
    """A robot whose processes are on the bus: how many, the state that it is in, why, and what it waits for."""

    processes: int
    state: str = ""
    reason: str = ""
    waiting_for: str = ""


@dataclass(frozen=True, slots=True)
class Shared:
    """What a robot has shared: how many maps of how many metres, and when the newest was begun, hours."""

    maps: int
    metres: float
    last_hours: float


def connected(present: Mapping[str, frozenset[str]], states: Mapping[str, m.State]) -> dict[str, Connected]:
    """The robots that are there now, by name; a state counts only while its robot is there."""
    there = {name: processes - _VISITORS for name, processes in sorted(present.items()) if name != FLEET}
    return {
        name: _connected(len(processes), states.get(name) if "navigator" in processes else None)
        for name, processes in there.items()
        if processes
    }


def shared(entries: Iterable[m.CatalogEntry]) -> dict[str, Shared]:
    """What each robot has shared, by name."""
    found: dict[str, list[m.CatalogEntry]] = {}
    for entry in entries:
        found.setdefault(robot_of(entry.map), []).append(entry)
    return {
        name: Shared(len(maps), sum(e.length for e in maps), max(e.stamp for e in maps) / _NS_PER_HOUR)
        for name, maps in sorted(found.items())
    }


def _connected(processes: int, state: m.State | None) -> Connected:
    if state is None:
        return Connected(processes)
    return Connected(processes, state.name.value, state.reason, state.waiting_for)
