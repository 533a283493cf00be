"""What is written to the store, within one transaction: each part is new, or there already, or refused."""

from __future__ import annotations

import sqlite3
import zlib

from common import wire
from common.errors import GraphError
from common.messages import Commit, GraphQuery, MapRecord, NamePlace, VertexRecord
from services.mapstore import appearance, edges
from services.mapstore.queries import RECORD_COLUMNS, StoredMap, find_map, find_vertex


def apply(db: sqlite3.Connection, commit: Commit) -> None:
    """Writes those parts of a commit that are not stored yet.

    Raises:
        GraphError: a part contradicts what is stored, or hangs in the air; the transaction must be rolled back.
    """
    if commit.map is not None:
        add_map(db, commit.map)
    if commit.vertex is not None:
        add_vertex(db, commit.vertex, find_map(db, commit.vertex.id.map_id))
    for edge in commit.edges:
        edges.add(db, edge)
    if commit.finished is not None:
        _finish(db, commit.finished)


def name_place(db: sqlite3.Connection, place: NamePlace) -> None:
    """Names a vertex, or moves the name to it.

    Raises:
        GraphError: the vertex is unknown or of another environment.
    """
    number, stored = find_vertex(db, place.vertex)
    if stored.environment != place.environment:
        raise GraphError(f"{place.vertex} is in environment '{stored.environment}', not '{place.environment}'")
    db.execute(
        "INSERT INTO places (environment, name, vertex) VALUES (?1, ?2, ?3) "
        "ON CONFLICT (environment, name) DO UPDATE SET vertex = ?3 WHERE vertex != ?3",
        (place.environment, place.place, number),
    )


def remove_map(db: sqlite3.Connection, query: GraphQuery) -> str:
    """Removes a map and its places; says what went. The edges between it and other maps wait for it to come back.

    Raises:
        GraphError: the query names no map, or vertices, or an unknown map, or one of another environment.
    """
    if query.map is None or query.vertices:
        raise GraphError("name the one map that shall be removed")
    stored = find_map(db, query.map, arriving=True)
    if query.environment not in {None, stored.environment}:
        raise GraphError(f"map {query.map} belongs to environment '{stored.environment}', not '{query.environment}'")
    names = [
        row[0]
        for row in db.execute(
            "SELECT name FROM places WHERE vertex IN (SELECT number FROM vertices WHERE map = ?) ORDER BY name",
            (stored.number,),
        )
    ]
    joints = edges.send_away(db, stored.number, query.map)
    db.execute("DELETE FROM maps WHERE number = ?", (stored.number,))
    places = f", and its places {', '.join(names)}" if names else ""
    return f"removed map {query.map}: {stored.vertices} vertices, {joints} edges to other maps{places}"


def add_map(db: sqlite3.Connection, record: MapRecord, *, arriving: bool = False) -> None:
    """Adds a map that is not stored yet; an arriving one is not seen by those who do not ask for it.

    Raises:
        GraphError: another map has its id.
    """
    values = tuple(getattr(record, column) for column in RECORD_COLUMNS)
    names = ", ".join(RECORD_COLUMNS)
    stored = db.execute(f"SELECT {names} FROM maps WHERE id = ?", (record.id,)).fetchone()  # noqa: S608, constants
    if stored is None:
        marks = ", ".join("?" * len(values))
        db.execute(f"INSERT INTO maps ({names}, arriving) VALUES ({marks}, ?)", (*values, arriving))  # noqa: S608, constants
    elif stored != values:
        raise GraphError(f"map {record.id} is stored already with another record")


def add_vertex(db: sqlite3.Connection, vertex: VertexRecord, stored: StoredMap) -> None:
    """Adds the next vertex of a map.

    Raises:
        GraphError: it is stored with other content, it is not the next, or the map is finished.
    """
    content = _content(vertex)
    if vertex.id.index < stored.vertices:
        _require_same_vertex(db, vertex, stored, content)
        return
    if stored.finished:
        raise GraphError(f"vertex {vertex.id} cannot be added: its map is finished")
    if vertex.id.index != stored.vertices:
        raise GraphError(f"vertex {vertex.id} leaves a gap: the next vertex of its map is {stored.vertices}")
    (number,) = db.execute(
        "INSERT INTO vertices (map, position, stamp) VALUES (?, ?, ?) RETURNING number",
        (stored.number, vertex.id.index, vertex.stamp),
    ).fetchone()
    db.execute(
        "INSERT INTO keyframes (vertex, checksum, content) VALUES (?, ?, ?)", (number, zlib.crc32(content), content)
    )
    size = len(content) + appearance.write(db, number, vertex.keyframe.appearance)
    db.execute("UPDATE maps SET vertices = vertices + 1, bytes = bytes + ? WHERE number = ?", (size, stored.number))


def _content(vertex: VertexRecord) -> bytes:
    """The keyframe as it is stored: without its appearance, which is kept apart."""
    return bytes(wire.encode(vertex.keyframe.model_copy(update={"appearance": {}})))


def _finish(db: sqlite3.Connection, map_id: str) -> None:
    number = find_map(db, map_id).number
    if db.execute("UPDATE maps SET finished = 1 WHERE number = ? AND NOT finished", (number,)).rowcount:
        edges.join(db, map_id)


def _require_same_vertex(db: sqlite3.Connection, vertex: VertexRecord, of: StoredMap, content: bytes) -> None:
    row = db.execute(
        "SELECT number, vertices.stamp, content FROM vertices JOIN keyframes ON vertex = number "
        "WHERE map = ? AND position = ?",
        (of.number, vertex.id.index),
    ).fetchone()
    looks = {stream: descriptors.tobytes() for stream, descriptors in vertex.keyframe.appearance.items()}
    if row is None or row[1:] != (vertex.stamp, content) or appearance.read(db, row[0]) != looks:
        raise GraphError(f"vertex {vertex.id} is stored already with other content")
