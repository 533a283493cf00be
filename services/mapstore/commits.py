"""What is written to the store, within one transaction: each part is new, or there already, or refused."""

from __future__ import annotations

import math
import sqlite3
import zlib

from common import wire
from common.errors import GraphError
from common.messages import Commit, EdgeRecord, GraphQuery, MapRecord, NamePlace, VertexRecord
from services.mapstore import appearance
from services.mapstore.queries import RECORD_COLUMNS, StoredMap, find_map, find_vertex


def apply(db: sqlite3.Connection, commit: Commit) -> None:
    """Writes those parts of a commit that are not stored yet.

    Raises:
        GraphError: a part contradicts what is stored, or hangs in the air; the transaction must be rolled back.
    """
    if commit.map is not None:
        _add_map(db, commit.map)
    if commit.vertex is not None:
        _add_vertex(db, commit.vertex)
    for edge in commit.edges:
        _add_edge(db, edge)
    if commit.finished is not None:
        db.execute("UPDATE maps SET finished = 1 WHERE number = ? AND NOT finished", find_map(db, commit.finished)[:1])


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
    """Removes a map, and with it the edges by which others are joined to it, and its places; says what went.

    Raises:
        GraphError: the query names no map, or vertices, or an unknown map, or one of another environment.
    """
    if query.map is None or query.vertices:
        raise GraphError("name the one map that shall be removed")
    stored = find_map(db, query.map)
    if query.environment not in {None, stored.environment}:
        raise GraphError(f"map {query.map} belongs to environment '{stored.environment}', not '{query.environment}'")
    own = "(SELECT number FROM vertices WHERE map = ?1)"
    (edges,) = db.execute(
        f"SELECT count(*) FROM edges WHERE (a IN {own}) != (b IN {own})",  # noqa: S608, constants
        (stored.number,),
    ).fetchone()
    names = [
        row[0]
        for row in db.execute(
            f"SELECT name FROM places WHERE vertex IN {own} ORDER BY name",  # noqa: S608, constants
            (stored.number,),
        )
    ]
    db.execute("DELETE FROM maps WHERE number = ?", (stored.number,))
    places = f", and its places {', '.join(names)}" if names else ""
    return f"removed map {query.map}: {stored.vertices} vertices, {edges} edges to other maps{places}"


def _add_map(db: sqlite3.Connection, record: MapRecord) -> None:
    values = tuple(getattr(record, column) for column in RECORD_COLUMNS)
    names = ", ".join(RECORD_COLUMNS)
    stored = db.execute(f"SELECT {names} FROM maps WHERE id = ?", (record.id,)).fetchone()  # noqa: S608, constants
    if stored is None:
        marks = ", ".join("?" * len(values))
        db.execute(f"INSERT INTO maps ({names}) VALUES ({marks})", values)  # noqa: S608, constants
    elif stored != values:
        raise GraphError(f"map {record.id} is stored already with another record")


def _add_vertex(db: sqlite3.Connection, vertex: VertexRecord) -> None:
    stored = find_map(db, vertex.id.map_id)
    content = _content(vertex)
    if vertex.id.index < stored.vertices:
        _require_same_vertex(db, vertex, content)
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


def _require_same_vertex(db: sqlite3.Connection, vertex: VertexRecord, content: bytes) -> None:
    number, _ = find_vertex(db, vertex.id)
    stored = db.execute(
        "SELECT stamp, content FROM vertices JOIN keyframes ON vertex = number WHERE number = ?", (number,)
    ).fetchone()
    looks = {stream: descriptors.tobytes() for stream, descriptors in vertex.keyframe.appearance.items()}
    if stored != (vertex.stamp, content) or appearance.read(db, number) != looks:
        raise GraphError(f"vertex {vertex.id} is stored already with other content")


def _add_edge(db: sqlite3.Connection, edge: EdgeRecord) -> None:
    (a, map_a), (b, map_b) = find_vertex(db, edge.a), find_vertex(db, edge.b)
    values = (a, b, edge.kind == "spatial", edge.T_a_b.tobytes(), edge.covariance.tobytes())
    stored = db.execute(
        "SELECT a, b, spatial, T_a_b, covariance FROM edges WHERE (a = ?1 AND b = ?2) OR (a = ?2 AND b = ?1)", (a, b)
    ).fetchone()
    if stored == values:
        return
    if stored is not None:
        raise GraphError(f"{edge.a} and {edge.b} are joined already by another edge")
    _require_joinable(edge, map_a, map_b)
    if edge.kind == "temporal":
        length = math.hypot(*edge.T_a_b[:3, 3].tolist())
        db.execute("UPDATE maps SET length = length + ? WHERE number = ?", (length, map_a.number))
    db.execute("INSERT INTO edges (a, b, spatial, T_a_b, covariance) VALUES (?, ?, ?, ?, ?)", values)


def _require_joinable(edge: EdgeRecord, map_a: StoredMap, map_b: StoredMap) -> None:
    """Refuses an edge that its kind, or its ends, do not allow. Spatial edges may come to finished maps at any time."""
    if edge.a == edge.b:
        raise GraphError(f"an edge cannot join {edge.a} to itself")
    if map_a.environment != map_b.environment:
        raise GraphError(f"{edge.a} and {edge.b} are in two environments, and no edge can join them")
    if edge.kind == "spatial":
        return
    if map_a.number != map_b.number or abs(edge.a.index - edge.b.index) != 1:
        raise GraphError(f"{edge.a} and {edge.b} do not follow each other: no temporal edge can join them")
    if map_a.finished:
        raise GraphError(f"the edge from {edge.a} to {edge.b} cannot be added: its map is finished")
