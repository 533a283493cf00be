"""Has a robot share and fetch maps, and watches it."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

from cli.errors import CommandError
from common import topics
from common.bus import Bus
from common.messages import FetchRequest, GraphQuery, MapList, MapSummary, PushRequest, SyncState, SyncStatus

if TYPE_CHECKING:
    from rich.progress import Progress

_ASK_S = 5.0
_POLL_S = 0.2
_QUIET_S = 60.0
"""With nothing moving for so long, it is no longer waited for."""


def push(bus: Bus, map_ids: Sequence[str], bar: Progress) -> list[MapSummary]:
    """Shares maps, all that wait where none is named.

    Raises:
        CommandError: one of them cannot be shared, or nothing moves any longer.
        BusError: the robot does not answer, or shares no maps.
    """
    bus.ask(topics.PUSH, PushRequest(maps=list(map_ids)), _ASK_S)
    wanted = set(map_ids) or {m.record.id for m in _maps(bus) if m.sync in {SyncState.WAITING, SyncState.UPLOADING}}

    def done() -> list[MapSummary]:
        found = [m for m in _maps(bus) if m.record.id in wanted]
        for summary in found:
            if summary.sync is SyncState.QUARANTINED:
                raise CommandError(f"map {summary.record.id} cannot be shared: {_reason(status.last(), summary)}")
        return [m for m in found if m.sync in {SyncState.SYNCED, SyncState.FETCHED}]

    status = _Watch(bus)
    return _wait(done, len(wanted), status, bar, "sharing")


def pull(bus: Bus, environment: str, map_ids: Sequence[str], bar: Progress) -> list[MapSummary]:
    """Fetches maps.

    Raises:
        CommandError: one of them cannot be fetched, or nothing moves any longer.
        BusError: the robot does not answer, or shares no maps.
    """
    status = _Watch(bus)
    wanted = list(dict.fromkeys(map_ids))
    bus.ask(topics.FETCH, FetchRequest(environment=environment, maps=wanted), _ASK_S)

    def done() -> list[MapSummary]:
        last = status.last()
        for row in [] if last is None else last.transfers:
            if not row.upload and row.map in wanted and row.state is SyncState.QUARANTINED:
                raise CommandError(row.reason)
        return [m for m in _maps(bus) if m.record.id in wanted]

    return _wait(done, len(wanted), status, bar, "fetching")


def text(maps: Sequence[MapSummary]) -> str:
    """What has been shared or fetched, for a reader."""
    lines = [f"{m.record.id}: {m.bytes / 1e6:.1f} MB, {m.sync.value.lower()}" for m in maps]
    return "\n".join(lines) or "there is nothing to be done"


class _Watch:
    """The map store's status, and when it last said something new."""

    def __init__(self, bus: Bus) -> None:
        self._status = bus.subscribe(topics.SYNC_STATUS)
        self._told: tuple[object, ...] = ()
        self.moved = time.monotonic()

    def last(self) -> SyncStatus | None:
        received = self._status.last()
        if received is None:
            return None
        status: SyncStatus = received.message
        told = tuple((row.map, row.state, row.done) for row in status.transfers)
        if told != self._told:
            self._told, self.moved = told, time.monotonic()
        return status


def _wait(
    done: Callable[[], list[MapSummary]], total: int, status: _Watch, bar: Progress, what: str
) -> list[MapSummary]:
    task = bar.add_task(what, total=total)
    while len(found := done()) < total:
        last = status.last()
        bar.update(task, completed=len(found))
        if time.monotonic() - status.moved > _QUIET_S:
            reason = "nothing moves any longer" if last is None or not last.reason else last.reason
            raise CommandError(f"{len(found)} of {total} maps are there, and {reason}")
        time.sleep(_POLL_S)
    return found


def _maps(bus: Bus) -> list[MapSummary]:
    answer: MapList = bus.ask(topics.MAPS, GraphQuery(), _ASK_S)
    return answer.maps


def _reason(status: SyncStatus | None, summary: MapSummary) -> str:
    rows = [] if status is None else [row for row in status.transfers if row.upload and row.map == summary.record.id]
    return rows[-1].reason if rows else "see the map store's log"
