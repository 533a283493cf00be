"""Stretches of maps on which the robot drives slowly, or not at all: the operator's word, kept on the robot alone."""

from __future__ import annotations

import sqlite3

from common.errors import GraphError
from common.messages import Restriction
from services.mapstore.queries import find_map


def restrict(db: sqlite3.Connection, wanted: Restriction) -> None:
    """Restricts a stretch, in place of whatever was restricted there before; without a speed, only lifts that.

    Raises:
        GraphError: the map is unknown, or the stretch goes beyond its end.
    """
    stored = find_map(db, wanted.map)
    if wanted.last >= stored.vertices:
        raise GraphError(f"map {wanted.map} has vertices 0 to {stored.vertices - 1}, and so none of {wanted.last}")
    before = db.execute(
        "DELETE FROM restrictions WHERE map = ? AND first <= ? AND last >= ? RETURNING first, last, speed, reason",
        (stored.number, wanted.last, wanted.first),
    ).fetchall()
    kept = [(first, wanted.first - 1, *rest) for first, _, *rest in before if first < wanted.first]
    kept += [(wanted.last + 1, last, *rest) for _, last, *rest in before if last > wanted.last]
    if wanted.speed is not None:
        kept.append((wanted.first, wanted.last, wanted.speed, wanted.reason))
    db.executemany(
        "INSERT INTO restrictions (map, first, last, speed, reason) VALUES (?, ?, ?, ?, ?)",
        [(stored.number, *row) for row in kept],
    )
