"""What the store knows of a map beside its graph: its ends, how far it is shared, and what repeats have to tell."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterable

from common.errors import GraphError
from common.messages import MapEnds, MapSummary, RepeatReport, SyncState, now_ns
from services.mapstore.queries import FIGURES, RECORD_COLUMNS, find_map, summary_of

MOST_REPORTS = 1000
"""Reports that wait at most; the oldest go first."""

_COLUMNS = ", ".join((*FIGURES, *RECORD_COLUMNS))
_GONE = (SyncState.SYNCED.value, SyncState.FETCHED.value)


def seal(db: sqlite3.Connection, ends: MapEnds) -> None:
    """Keeps the places that a finished map leads from and to: it is whole now, and may be shared.

    The ends of a taught map that have no name are their vertices, ``map:0`` and ``map:last``.

    Raises:
        GraphError: the map is unknown or not finished, or other ends were told before.
    """
    stored = find_map(db, ends.map)
    if not stored.finished:
        raise GraphError(f"map {ends.map} is not finished, so its ends are not known yet")
    generation, sealed, start, end = db.execute(
        "SELECT generation, sealed, start_place, end_place FROM maps WHERE number = ?", (stored.number,)
    ).fetchone()
    wanted = (ends.start_place, ends.end_place)
    if generation == 0:
        wanted = (wanted[0] or f"{ends.map}:0", wanted[1] or f"{ends.map}:{stored.vertices - 1}")
    if sealed and (start, end) != wanted:
        raise GraphError(f"map {ends.map} leads from '{start}' to '{end}' already, and cannot be told other ends")
    if not sealed:
        db.execute(
            "UPDATE maps SET sealed = 1, start_place = ?, end_place = ?, sync = ? WHERE number = ?",
            (*wanted, SyncState.WAITING.value, stored.number),
        )


def seal_all(db: sqlite3.Connection, robot: str, map_ids: Iterable[str], before_ns: int) -> None:
    """Seals the robot's finished maps whose ends nobody told: those that are named, and those begun before a time."""
    named = set(map_ids)
    rows = db.execute(
        "SELECT id, stamp, generation FROM maps WHERE robot = ? AND finished AND NOT sealed AND vertices > 0", (robot,)
    ).fetchall()
    for map_id, stamp, _ in rows:
        if map_id in named or stamp < before_ns:
            seal(db, MapEnds(map=map_id))


def to_share(db: sqlite3.Connection, robot: str) -> list[MapSummary]:
    """The robot's sealed maps that are not in the fleet's storage and not in quarantine, oldest first."""
    rows = db.execute(
        f"SELECT {_COLUMNS} FROM maps WHERE robot = ? AND sealed AND NOT arriving AND sync IN (?, ?) "  # noqa: S608, constants
        "ORDER BY stamp, id",
        (robot, SyncState.WAITING.value, SyncState.UPLOADING.value),
    )
    return [summary_of(row) for row in rows]


def set_sync(db: sqlite3.Connection, map_id: str, state: SyncState, reason: str) -> None:
    """Keeps how far a map is shared."""
    db.execute("UPDATE maps SET sync = ?, sync_reason = ? WHERE id = ?", (state.value, reason, map_id))


def retry(db: sqlite3.Connection, robot: str, map_ids: Iterable[str]) -> int:
    """Takes the robot's maps out of quarantine, those that are named or all; returns how many."""
    named = list(map_ids)
    found = [
        row[0]
        for row in db.execute("SELECT id FROM maps WHERE robot = ? AND sync = ?", (robot, SyncState.QUARANTINED.value))
        if not named or row[0] in named
    ]
    for map_id in found:
        set_sync(db, map_id, SyncState.WAITING, "")
    return len(found)


def counts(db: sqlite3.Connection) -> tuple[int, int, int]:
    """How many maps wait to be shared, how many are in the fleet's storage, and the bytes of all."""
    rows = dict(db.execute("SELECT sync, count(*) FROM maps WHERE NOT arriving GROUP BY sync").fetchall())
    waiting = sum(rows.get(state.value, 0) for state in (SyncState.WAITING, SyncState.UPLOADING))
    (size,) = db.execute("SELECT coalesce(sum(bytes), 0) FROM maps").fetchone()
    return waiting, sum(rows.get(state, 0) for state in _GONE), size


def touch(db: sqlite3.Connection, map_ids: Iterable[str]) -> None:
    """Remembers that maps are used now."""
    now = now_ns()
    db.executemany("UPDATE maps SET used = ? WHERE id = ?", [(now, map_id) for map_id in map_ids])


def removable(db: sqlite3.Connection) -> list[MapSummary]:
    """Maps that are safe in the fleet's storage, the one that was used or made longest ago first.

    Those that began to arrive and never came to an end are among them.
    """
    rows = db.execute(
        f"SELECT {_COLUMNS} FROM maps WHERE sync IN (?, ?) OR arriving "  # noqa: S608, constants
        "ORDER BY max(used, stamp), id",
        _GONE,
    )
    return [summary_of(row) for row in rows]


def add_report(db: sqlite3.Connection, report: RepeatReport) -> None:
    """Keeps a report until it is told."""
    db.execute("INSERT OR IGNORE INTO reports VALUES (?, ?)", (report.id, report.model_dump_json().encode()))
    db.execute("DELETE FROM reports WHERE id NOT IN (SELECT id FROM reports ORDER BY id DESC LIMIT ?)", (MOST_REPORTS,))


def reports(db: sqlite3.Connection, limit: int) -> list[RepeatReport]:
    """The reports that wait, oldest first, for their ids sort by time."""
    rows = db.execute("SELECT content FROM reports ORDER BY id LIMIT ?", (limit,))
    return [RepeatReport.model_validate_json(row[0]) for row in rows]


def drop_report(db: sqlite3.Connection, report: str) -> None:
    """Forgets a report that is told."""
    db.execute("DELETE FROM reports WHERE id = ?", (report,))
