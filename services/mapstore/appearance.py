"""The small part of a vertex by which its place is recognised: kept apart from the keyframe, and read by the thousand.

2000 keyframes take some 400 MB, the descriptors that recognise them 13 MB a stream.
"""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from common import wire
from common.errors import MalformedMessage
from common.messages import AppearanceQuery, Appearances, Keyframe, MapRecord

PAGE_BYTES = 4_000_000
"""Descriptors of one answer, but for what the last vertex adds: an answer of more would hold others up."""

_WIDTH = 32
_SUFFIX = "/descriptors"
_KEPT = 200

Descriptors = NDArray[np.uint8]


class _Row(NamedTuple):
    """A stored vertex: its map's place in the answer, its index there, and its descriptors by stream."""

    map: int
    position: int
    streams: dict[str, bytes]


def write(db: sqlite3.Connection, vertex: int, appearance: dict[str, Descriptors]) -> int:
    """Stores what a vertex looks like, by its number in the store; returns the bytes that this took."""
    rows = [(vertex, stream, descriptors.tobytes()) for stream, descriptors in sorted(appearance.items())]
    db.executemany("INSERT INTO appearances (vertex, stream, descriptors) VALUES (?, ?, ?)", rows)
    return sum(len(row[2]) for row in rows)


def read(db: sqlite3.Connection, vertex: int) -> dict[str, bytes]:
    """What is stored of a vertex, by stream."""
    return dict(db.execute("SELECT stream, descriptors FROM appearances WHERE vertex = ?", (vertex,)).fetchall())


def unpacked(blob: bytes) -> Descriptors:
    """Stored descriptors (N, 32) again."""
    return np.frombuffer(blob, dtype=np.uint8).reshape(-1, _WIDTH)


def page(db: sqlite3.Connection, query: AppearanceQuery, maps: list[tuple[int, MapRecord]]) -> Appearances:
    """The next page of an environment's vertices; ``maps`` are its maps with their numbers in the store."""
    rows: list[_Row] = []
    size = 0
    for row in _unknown(db, query, maps):
        if size >= PAGE_BYTES:
            return _packed(rows, maps, more=True)
        rows.append(row)
        size += sum(map(len, row.streams.values()))
    return _packed(rows, maps, more=False)


def of_old_keyframe(content: bytes, stream: str) -> bytes | None:
    """Descriptors for a vertex that was stored without any, of its keyframe; None where that has none of the stream.

    A keyframe's landmarks are in reading order, so that every n-th of them lie all over the image.
    """
    try:
        arrays = wire.decode(Keyframe, content).arrays
    except MalformedMessage:
        return None
    found = arrays.get(stream + _SUFFIX)
    if found is None or found.dtype != np.uint8 or found.shape[1:] != (_WIDTH,) or len(found) == 0:
        return None
    rows = np.unique(np.linspace(0, len(found) - 1, _KEPT).astype(np.int64))
    return found[rows].tobytes()


def _unknown(db: sqlite3.Connection, query: AppearanceQuery, maps: list[tuple[int, MapRecord]]) -> Iterator[_Row]:
    for k, (number, record) in enumerate(maps):
        place = (number, query.known.get(record.id, 0))
        found = db.execute(
            "SELECT number, position FROM vertices WHERE map = ? AND position >= ? ORDER BY position", place
        )
        for vertex, position in found:
            yield _Row(k, position, read(db, vertex))


def _packed(rows: list[_Row], maps: list[tuple[int, MapRecord]], *, more: bool) -> Appearances:
    streams = sorted({stream for row in rows for stream in row.streams})
    counts, descriptors = {}, {}
    for stream in streams:
        blobs = [row.streams.get(stream, b"") for row in rows]
        counts[stream] = np.array([len(blob) // _WIDTH for blob in blobs], dtype=np.int32)
        descriptors[stream] = np.frombuffer(b"".join(blobs), dtype=np.uint8).reshape(-1, _WIDTH)
    return Appearances(
        maps=[record for _, record in maps],
        vertices=np.array([row[:2] for row in rows], dtype=np.int32).reshape(-1, 2),
        counts=counts,
        descriptors=descriptors,
        more=more,
    )
