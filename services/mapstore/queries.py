"""What is read from the store, within one snapshot of it."""

from __future__ import annotations

import sqlite3
import zlib
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import structlog
from numpy.typing import NDArray

from common import geometry, wire
from common.errors import GraphError
from common.geometry import Array
from common.ids import VertexId
from common.messages import (
    AppearanceQuery,
    Appearances,
    GraphQuery,
    Keyframe,
    MapList,
    MapRecord,
    MapSummary,
    Restriction,
    Submap,
    Topology,
    VertexRecord,
)
from services.mapstore import appearance
from services.mapstore.errors import StoreError

MAX_SUBMAP = 256
"""Most vertices of one answer: with 150 kB each, 40 MB."""

RECORD_COLUMNS = tuple(MapRecord.model_fields)
"""The columns of a map's record are named as its fields."""

FIGURES = ("vertices", "length", "bytes", "finished", "start_place", "end_place", "sync")
"""The columns of a summary beside its record's, named as its fields."""

log = structlog.get_logger()


class StoredMap(NamedTuple):
    """A map's row: its number in the store, environment, next index, and whether it is finished, and sealed."""

    number: int
    environment: str
    vertices: int
    finished: bool
    sealed: bool


def find_map(db: sqlite3.Connection, map_id: str, *, arriving: bool = False) -> StoredMap:
    """The row of a map; one of which half an archive has come is found only by those who ask for it so.

    Raises:
        GraphError: there is none.
    """
    row = db.execute(
        "SELECT number, environment, vertices, finished, sealed FROM maps WHERE id = ? AND arriving <= ?",
        (map_id, arriving),
    ).fetchone()
    if row is None:
        raise GraphError(f"the store has no map {map_id}")
    return StoredMap(*row)


def find_vertex(db: sqlite3.Connection, vertex: VertexId, *, arriving: bool = False) -> tuple[int, StoredMap]:
    """A vertex's number in the store, and its map's row; ``arriving`` as in :func:`find_map`.

    Raises:
        GraphError: there is none.
    """
    stored = find_map(db, vertex.map_id, arriving=arriving)
    place = (stored.number, vertex.index)
    row = db.execute("SELECT number FROM vertices WHERE map = ? AND position = ?", place).fetchone()
    if row is None:
        raise GraphError(f"the store has no vertex {vertex}: its map has {stored.vertices} vertices")
    return int(row[0]), stored


def maps(db: sqlite3.Connection, query: GraphQuery) -> MapList:
    """Summaries of every map, of an environment's, or of one, oldest first.

    Raises:
        GraphError: the map that is named is unknown, or of another environment than the one named.
    """
    if query.map is not None:
        _require_environment(query, find_map(db, query.map).environment)
    return MapList(maps=list(_summaries(db, query.environment, query.map).values()))


def topology(db: sqlite3.Connection, query: GraphQuery) -> Topology:
    """An environment's graph without keyframes; that of one without maps is empty.

    Raises:
        GraphError: no environment is named, by itself or by a map, and the store has not exactly one.
    """
    environment = _environment(db, query)
    summaries = _summaries(db, environment, None)
    order = {number: k for k, number in enumerate(summaries)}
    rows = db.execute(
        "SELECT va.map, va.position, vb.map, vb.position, spatial, T_a_b, covariance FROM maps "
        "JOIN vertices va ON va.map = maps.number JOIN edges ON a = va.number JOIN vertices vb ON vb.number = b "
        "WHERE environment = ? AND NOT arriving ORDER BY a, b",
        (environment,),
    ).fetchall()
    # A map that is arriving may be joined to others already.
    rows = [row for row in rows if row[2] in order]
    ends = [(order[row[0]], row[1], order[row[2]], row[3]) for row in rows]
    return Topology(
        environment=environment,
        maps=list(summaries.values()),
        edges=np.array(ends, dtype=np.int32).reshape(-1, 4),
        spatial=np.array([row[4] for row in rows], dtype=np.uint8),
        T_a_b=_matrices([row[5] for row in rows], 4),
        covariances=_matrices([row[6] for row in rows], 6),
        places=_places(db, environment),
        restrictions=_restrictions(db, environment),
    )


def submap(db: sqlite3.Connection, query: GraphQuery) -> Submap:
    """The vertices that are named, or those of a map, with their keyframes.

    A damaged keyframe is left out and logged: the sound ones beside it are still good to localize against.

    Raises:
        GraphError: none or too many are asked for, or one is unknown.
        StoreError: every one is damaged.
    """
    wanted = _wanted(db, query)
    records = [record for vertex in wanted if (record := _read_vertex(db, vertex)) is not None]
    if not records:
        raise StoreError(f"the store's keyframe of {wanted[0]} is damaged")
    return Submap(vertices=records)


def whole_vertex(db: sqlite3.Connection, vertex: VertexId) -> VertexRecord:
    """A vertex as it was committed, with its appearance.

    Raises:
        GraphError: it is unknown, or the disk has spoilt it.
    """
    record = _read_vertex(db, vertex)
    if record is None:
        raise GraphError(f"the store's keyframe of {vertex} is damaged")
    number, _ = find_vertex(db, vertex)
    looks = {stream: appearance.unpacked(blob) for stream, blob in sorted(appearance.read(db, number).items())}
    return record.model_copy(update={"keyframe": record.keyframe.model_copy(update={"appearance": looks})})


def track(db: sqlite3.Connection, map_id: str) -> tuple[NDArray[np.int64], Array]:
    """When each vertex of a map was made, ns (N,), and the way from each to the next, (N - 1, 4, 4).

    Raises:
        GraphError: the map is unknown, or no edge joins two of its vertices that follow each other.
    """
    stored = find_map(db, map_id)
    stamps = db.execute("SELECT stamp FROM vertices WHERE map = ? ORDER BY position", (stored.number,)).fetchall()
    rows = db.execute(
        "SELECT va.position, vb.position, T_a_b FROM edges JOIN vertices va ON va.number = a "
        "JOIN vertices vb ON vb.number = b WHERE va.map = ?1 AND vb.map = ?1 AND NOT spatial "
        "ORDER BY min(va.position, vb.position)",
        (stored.number,),
    ).fetchall()
    if [min(row[:2]) for row in rows] != list(range(len(stamps) - 1)):
        raise GraphError(f"the vertices of map {map_id} are not joined to one another")
    steps = _matrices([row[2] for row in rows], 4).copy()
    against = np.array([row[0] > row[1] for row in rows], dtype=bool)
    steps[against] = geometry.inverse(steps[against])
    return np.array(stamps, dtype=np.int64).reshape(-1), steps


def appearances(db: sqlite3.Connection, query: AppearanceQuery) -> Appearances:
    """What an environment's vertices look like, but for those that are known; one page of them."""
    maps = [(number, summary.record) for number, summary in _summaries(db, query.environment, None).items()]
    return appearance.page(db, query, maps)


def _wanted(db: sqlite3.Connection, query: GraphQuery) -> Sequence[VertexId]:
    if query.vertices:
        return query.vertices
    if query.map is None:
        raise GraphError("a submap is asked for by its vertices, or by its map")
    stored = find_map(db, query.map)
    if not 0 < stored.vertices <= MAX_SUBMAP:
        raise GraphError(
            f"map {query.map} has {stored.vertices} vertices, and a submap 1 to {MAX_SUBMAP}: name the vertices"
        )
    return [VertexId(query.map, index) for index in range(stored.vertices)]


def _read_vertex(db: sqlite3.Connection, vertex: VertexId) -> VertexRecord | None:
    """A vertex as it was committed; None, logged, where the disk has spoilt it."""
    number, _ = find_vertex(db, vertex)
    row = db.execute(
        "SELECT stamp, checksum, content FROM vertices JOIN keyframes ON vertex = number WHERE number = ?", (number,)
    ).fetchone()
    if row is None or zlib.crc32(row[2]) != row[1]:
        log.error("a stored keyframe is damaged", vertex=str(vertex))
        return None
    return VertexRecord(id=vertex, stamp=row[0], keyframe=wire.decode(Keyframe, row[2]))


def _summaries(db: sqlite3.Connection, environment: str | None, map_id: str | None) -> dict[int, MapSummary]:
    """Summaries by the maps' numbers in the store, oldest first."""
    rows = db.execute(
        f"SELECT number, {', '.join((*FIGURES, *RECORD_COLUMNS))} FROM maps "  # noqa: S608, constants
        "WHERE (?1 IS NULL OR environment = ?1) AND (?2 IS NULL OR id = ?2) AND NOT arriving ORDER BY stamp, id",
        (environment, map_id),
    )
    return {number: summary_of(columns) for number, *columns in rows}


def summary_of(columns: Sequence[Any]) -> MapSummary:
    """A map's summary of its :data:`FIGURES` and :data:`RECORD_COLUMNS`."""
    figures = dict(zip(FIGURES, columns, strict=False))
    record = MapRecord(**dict(zip(RECORD_COLUMNS, columns[len(FIGURES) :], strict=True)))
    return MapSummary(record=record, **figures | {"finished": bool(figures["finished"])})


def _environment(db: sqlite3.Connection, query: GraphQuery) -> str:
    if query.map is not None:
        environment = find_map(db, query.map).environment
        _require_environment(query, environment)
        return environment
    if query.environment is not None:
        return query.environment
    known = [
        row[0]
        for row in db.execute("SELECT DISTINCT environment FROM maps WHERE NOT arriving ORDER BY environment LIMIT 9")
    ]
    if len(known) != 1:
        listed = f"the store has {', '.join(known)}" if known else "the store has no maps"
        raise GraphError(f"name an environment: {listed}")
    return str(known[0])


def _require_environment(query: GraphQuery, environment: str) -> None:
    if query.environment not in {None, environment}:
        raise GraphError(f"map {query.map} belongs to environment '{environment}', not '{query.environment}'")


def _restrictions(db: sqlite3.Connection, environment: str) -> list[Restriction]:
    rows = db.execute(
        "SELECT id, first, last, speed, reason FROM restrictions JOIN maps ON maps.number = restrictions.map "
        "WHERE environment = ? AND NOT arriving ORDER BY id, first",
        (environment,),
    )
    return [Restriction(map=row[0], first=row[1], last=row[2], speed=row[3], reason=row[4]) for row in rows]


def _places(db: sqlite3.Connection, environment: str) -> dict[str, VertexId]:
    rows = db.execute(
        "SELECT name, id, position FROM places JOIN vertices ON vertices.number = vertex "
        "JOIN maps ON maps.number = map WHERE places.environment = ? AND NOT arriving ORDER BY name",
        (environment,),
    )
    return {name: VertexId(map_id, index) for name, map_id, index in rows}


def _matrices(blobs: list[bytes], size: int) -> Array:
    """Matrices (N, size, size) of their stored bytes."""
    return np.frombuffer(b"".join(blobs), dtype="<f8").reshape(-1, size, size)
