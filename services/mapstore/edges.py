"""Edges as they are stored, and those that wait for a map at their other end.

An edge is part of a map's archive if it touched the map when that was sealed: one that is found later changes nothing
that has left the robot. The columns ``in_a`` and ``in_b`` keep this for the maps of both ends.
"""

from __future__ import annotations

import math
import sqlite3
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from common.errors import GraphError
from common.geometry import Array
from common.ids import VertexId
from common.messages import EdgeRecord
from services.mapstore.queries import StoredMap, find_vertex

_WAITING = "a_map, a_position, b_map, b_position, T_a_b, covariance, in_a, in_b"
_KEY = "a_map, a_position, b_map, b_position"
_SAME = "a_map = ? AND a_position = ? AND b_map = ? AND b_position = ?"

_JOINED = """
FROM vertices va JOIN edges ON a = va.number JOIN vertices vb ON vb.number = b
JOIN maps ma ON ma.number = va.map JOIN maps mb ON mb.number = vb.map
"""

_READY = """
FROM waiting_edges w
JOIN maps ma ON ma.id = w.a_map JOIN vertices va ON va.map = ma.number AND va.position = w.a_position
JOIN maps mb ON mb.id = w.b_map JOIN vertices vb ON vb.map = mb.number AND vb.position = w.b_position
WHERE (w.a_map = ?1 OR w.b_map = ?1) AND ma.environment = mb.environment
"""

_COLUMNS = "ma.id, va.position, mb.id, vb.position, T_a_b, covariance"

_OF_MAP = f"""
SELECT spatial, {_COLUMNS} {_JOINED} WHERE va.map = ?1 AND in_a
UNION ALL
SELECT spatial, {_COLUMNS} {_JOINED} WHERE vb.map = ?1 AND in_b AND NOT (va.map = ?1 AND in_a)
UNION ALL
SELECT 1, a_map, a_position, b_map, b_position, T_a_b, covariance FROM waiting_edges
WHERE (a_map = ?2 AND in_a) OR (b_map = ?2 AND in_b)
ORDER BY 1, 2, 3, 4, 5
"""  # noqa: S608, constants


class _Ends(NamedTuple):
    """The vertices that an edge joins, by their numbers in the store, and their maps."""

    a: int
    b: int
    map_a: StoredMap
    map_b: StoredMap


def add(db: sqlite3.Connection, edge: EdgeRecord) -> None:
    """Adds an edge that is not stored yet.

    Raises:
        GraphError: it contradicts what is stored, or joins what cannot be joined.
    """
    (a, map_a), (b, map_b) = find_vertex(db, edge.a), find_vertex(db, edge.b)
    _put(db, edge, _Ends(a, b, map_a, map_b), (not map_a.sealed, not map_b.sealed))


def add_of_archive(db: sqlite3.Connection, edge: EdgeRecord, map_id: str) -> None:
    """Adds an edge of a map's archive; where its other end is not here, or refuses it, the edge waits for another.

    Raises:
        GraphError: it contradicts what is stored of the map itself.
    """
    inside = edge.a.map_id == edge.b.map_id
    shares = _fetched(db, edge, (edge.a.map_id == map_id, edge.b.map_id == map_id))
    try:
        (a, map_a), (b, map_b) = (find_vertex(db, end, arriving=True) for end in (edge.a, edge.b))
        _put(db, edge, _Ends(a, b, map_a, map_b), shares)
    except GraphError:
        if inside:
            raise
        _let_wait(db, edge, shares)


def send_away(db: sqlite3.Connection, number: int, map_id: str) -> int:
    """Lets the edges between a map that is about to be removed and others wait for its return; returns how many.

    They may be part of the others' archives, and the map may come back.
    """
    moved = 0
    for own, other in (("va", "vb"), ("vb", "va")):
        moved += db.execute(
            f"INSERT OR IGNORE INTO waiting_edges ({_WAITING}) SELECT {_COLUMNS}, in_a, in_b {_JOINED} "
            f"WHERE {own}.map = ?1 AND {other}.map != ?1",
            (number,),
        ).rowcount
    others = "SELECT 1 FROM maps WHERE number != ?2 AND id ="
    db.execute(
        f"DELETE FROM waiting_edges WHERE (a_map = ?1 AND NOT EXISTS ({others} b_map)) "  # noqa: S608, constants
        f"OR (b_map = ?1 AND NOT EXISTS ({others} a_map))",
        (map_id, number),
    )
    return moved


def join(db: sqlite3.Connection, map_id: str) -> None:
    """Adds the edges that waited for a map; one that contradicts an edge which is here waits on."""
    either = "(e.a = va.number AND e.b = vb.number) OR (e.a = vb.number AND e.b = va.number)"
    db.execute(
        "INSERT INTO edges (a, b, spatial, T_a_b, covariance, in_a, in_b) "  # noqa: S608, constants
        f"SELECT va.number, vb.number, 1, w.T_a_b, w.covariance, w.in_a, w.in_b {_READY} "
        f"AND NOT EXISTS (SELECT 1 FROM edges e WHERE {either})",
        (map_id,),
    )
    db.execute(
        f"DELETE FROM waiting_edges WHERE ({_KEY}) IN (SELECT {_KEY} {_READY} AND EXISTS (SELECT 1 FROM edges e "  # noqa: S608, constants
        "WHERE e.a = va.number AND e.b = vb.number AND e.T_a_b = w.T_a_b AND e.covariance = w.covariance))",
        (map_id,),
    )


def of_map(db: sqlite3.Connection, number: int, map_id: str) -> Iterator[EdgeRecord]:
    """The edges that are part of a map's archive: temporal ones first, each kind by the ids of its ends."""
    for spatial, a_map, a, b_map, b, transform, covariance in db.execute(_OF_MAP, (number, map_id)):
        yield EdgeRecord(
            kind="spatial" if spatial else "temporal",
            a=VertexId(a_map, a),
            b=VertexId(b_map, b),
            T_a_b=_matrix(transform, 4),
            covariance=_matrix(covariance, 6),
        )


def _put(db: sqlite3.Connection, edge: EdgeRecord, ends: _Ends, shares: tuple[bool, bool]) -> None:
    values = (ends.a, ends.b, edge.kind == "spatial", edge.T_a_b.tobytes(), edge.covariance.tobytes())
    stored = db.execute(
        "SELECT a, b, spatial, T_a_b, covariance FROM edges WHERE (a = ?1 AND b = ?2) OR (a = ?2 AND b = ?1)",
        values[:2],
    ).fetchone()
    if stored is not None and stored != values:
        raise GraphError(f"{edge.a} and {edge.b} are joined already by another edge")
    if stored is not None:
        db.execute(
            "UPDATE edges SET in_a = max(in_a, ?3), in_b = max(in_b, ?4) "
            "WHERE a = ?1 AND b = ?2 AND (in_a < ?3 OR in_b < ?4)",
            (ends.a, ends.b, *shares),
        )
        return
    _require_joinable(edge, ends)
    if edge.kind == "temporal":
        length = math.hypot(*edge.T_a_b[:3, 3].tolist())
        db.execute("UPDATE maps SET length = length + ? WHERE number = ?", (length, ends.map_a.number))
    db.execute(
        "INSERT INTO edges (a, b, spatial, T_a_b, covariance, in_a, in_b) VALUES (?, ?, ?, ?, ?, ?, ?)",
        (*values, *shares),
    )


def _require_joinable(edge: EdgeRecord, ends: _Ends) -> None:
    """Refuses an edge that its kind, or its ends, do not allow. Spatial edges may come to finished maps at any time."""
    if edge.a == edge.b:
        raise GraphError(f"an edge cannot join {edge.a} to itself")
    if ends.map_a.environment != ends.map_b.environment:
        raise GraphError(f"{edge.a} and {edge.b} are in two environments, and no edge can join them")
    if edge.kind == "spatial":
        return
    if ends.map_a.number != ends.map_b.number or abs(edge.a.index - edge.b.index) != 1:
        raise GraphError(f"{edge.a} and {edge.b} do not follow each other: no temporal edge can join them")
    if ends.map_a.finished:
        raise GraphError(f"the edge from {edge.a} to {edge.b} cannot be added: its map is finished")


def _fetched(db: sqlite3.Connection, edge: EdgeRecord, shares: tuple[bool, bool]) -> tuple[bool, bool]:
    """Takes an edge from among those that wait; returns of which ends' archives it then is part."""
    row = db.execute(
        f"DELETE FROM waiting_edges WHERE {_SAME} AND T_a_b = ? AND covariance = ? RETURNING in_a, in_b",  # noqa: S608, constants
        (*edge.a, *edge.b, edge.T_a_b.tobytes(), edge.covariance.tobytes()),
    ).fetchone()
    return shares if row is None else (bool(row[0] or shares[0]), bool(row[1] or shares[1]))


def _let_wait(db: sqlite3.Connection, edge: EdgeRecord, shares: tuple[bool, bool]) -> None:
    """Keeps an edge for later; of two that contradict each other, the first."""
    if db.execute(f"SELECT 1 FROM waiting_edges WHERE {_SAME}", (*edge.b, *edge.a)).fetchone() is None:  # noqa: S608, constants
        db.execute(
            f"INSERT OR IGNORE INTO waiting_edges ({_WAITING}) VALUES (?, ?, ?, ?, ?, ?, ?, ?)",  # noqa: S608, constants
            (*edge.a, *edge.b, edge.T_a_b.tobytes(), edge.covariance.tobytes(), *shares),
        )


def _matrix(blob: bytes, size: int) -> Array:
    return np.frombuffer(blob, dtype="<f8").reshape(size, size)
