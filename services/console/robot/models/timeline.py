"""What happened, and when: told from one look to the next."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from common.messages import Localization, SafetyStatus, State, StateName

_QUIET_RULES = frozenset({"state_forbids", "command_stale"})
"""What safety says of every robot that rests: no event."""


@dataclass(frozen=True, slots=True)
class Event:
    """Something that happened: its kind, one sentence, and whether it is bad news."""

    kind: str
    text: str
    bad: bool = False

    def section(self, stamp_ms: int) -> dict[str, Any]:
        """As a page takes it."""
        return {"t": stamp_ms, "kind": self.kind, "text": self.text, "bad": self.bad}


class Timeline:
    """Notices what is new in each message and presence; the first look is no news."""

    def __init__(self) -> None:
        self._state: State | None = None
        self._safety: frozenset[str] | None = None
        self._latched: bool | None = None
        self._present: frozenset[str] | None = None
        self._localized: bool | None = None

    def state(self, state: State) -> Iterator[Event]:
        """Another state, or another reason for the same."""
        before, self._state = self._state, state
        if before is not None and (before.name, before.reason) == (state.name, state.reason):
            return
        lost = state.name is StateName.PAUSED and "operator" not in state.reason
        yield Event("state", f"{state.name.value}: {state.reason}" if state.reason else state.name.value, bad=lost)
        if state.closure is not None and (before is None or before.closure is None):
            yield Event("closure", f"a loop closure with {state.closure.edge.b} waits for confirmation")

    def safety(self, status: SafetyStatus) -> Iterator[Event]:
        """A rule that objects which did not before, or none does any longer."""
        rules = {reason.rule: reason.text for reason in status.reasons if reason.rule not in _QUIET_RULES}
        before, self._safety = self._safety, frozenset(rules)
        latched, self._latched = self._latched, status.latched
        if latched and not status.latched:
            yield Event("safety", "the emergency stop is released")
        for rule, text in rules.items():
            if rule not in (before or ()):
                yield Event("safety", text, bad=True)
        if before and not rules and not latched:
            yield Event("safety", "nothing holds the robot back any longer")

    def presence(self, present: frozenset[str]) -> Iterator[Event]:
        """A process that came or went; operators' commands come and go all the time."""
        before, self._present = self._present, present
        if before is None:
            return
        for name in sorted(before - present - {"operator"}):
            yield Event("process", f"{name} has gone", bad=True)
        for name in sorted(present - before - {"operator"}):
            yield Event("process", f"{name} is there")

    def localization(self, found: Localization) -> Iterator[Event]:
        """Lost and found."""
        before, self._localized = self._localized, found.success
        if before is not None and before != found.success:
            where = f"localized against {found.trunk} by the {found.stream} images"
            yield Event("localization", where if found.success else f"not localized: {found.reason}", not found.success)
