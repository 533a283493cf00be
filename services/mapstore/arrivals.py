"""A map that comes from the fleet, part by part: nobody sees it before it is whole."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterable

from common.errors import GraphError
from common.messages import EdgeRecord, MapEnds, MapRecord, SyncState, VertexRecord
from services.mapstore import commits, edges
from services.mapstore.errors import StoreError
from services.mapstore.queries import StoredMap, find_map


def begin(db: sqlite3.Connection, record: MapRecord) -> bool:
    """Makes room for a map; returns False where it is here already, whole.

    Raises:
        GraphError: another map, or one that is being taught, has its id.
    """
    commits.add_map(db, record, arriving=True)
    arriving, finished = db.execute("SELECT arriving, finished FROM maps WHERE id = ?", (record.id,)).fetchone()
    if not arriving and not finished:
        raise GraphError(f"map {record.id} is being made here, and cannot arrive from elsewhere")
    return bool(arriving)


def add(db: sqlite3.Connection, vertices: Iterable[VertexRecord]) -> None:
    """Keeps the next vertices of an arriving map; those that are here already stay as they are.

    Raises:
        GraphError: the part that came before holds other vertices.
        StoreError: that part is gone.
    """
    for vertex in vertices:
        commits.add_vertex(db, vertex, _find(db, vertex.id.map_id))


def join(db: sqlite3.Connection, map_id: str, some: Iterable[EdgeRecord]) -> None:
    """Joins vertices of an arriving map to each other and to those of other maps, now or when those come.

    Raises:
        GraphError: an edge contradicts what is stored of the map itself.
        StoreError: the map is gone.
    """
    _find(db, map_id)
    for edge in some:
        edges.add_of_archive(db, edge, map_id)


def finish(db: sqlite3.Connection, ends: MapEnds, state: SyncState) -> None:
    """Joins an arriving map to those that waited for it, and lets everybody see it.

    The ends are told by whoever made it, and are kept as they are.

    Raises:
        StoreError: the map is gone.
    """
    _find(db, ends.map)
    db.execute(
        "UPDATE maps SET arriving = 0, finished = 1, sealed = 1, start_place = ?, end_place = ?, sync = ? WHERE id = ?",
        (ends.start_place, ends.end_place, state.value, ends.map),
    )
    edges.join(db, ends.map)


def _find(db: sqlite3.Connection, map_id: str) -> StoredMap:
    """An arriving map; it may have been removed to make room."""
    try:
        return find_map(db, map_id, arriving=True)
    except GraphError:
        raise StoreError(f"map {map_id} was removed while it arrived: begin again") from None
