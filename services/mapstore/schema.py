"""The store's tables, and how a store of any older version becomes one of this version.

Version ``n`` is what the first ``n`` entries of :data:`MIGRATIONS` make of an empty file. A released entry is never
edited: a change is a new entry.
"""

from __future__ import annotations

import sqlite3
from collections.abc import Sequence

from services.mapstore.appearance import of_old_keyframe
from services.mapstore.errors import StoreError

APPLICATION_ID = 0x56545247
"""Stands in the file's header ("VTRG"), so that another program's database is not taken for a store."""

Migration = tuple[str, ...]

MIGRATIONS: tuple[Migration, ...] = (
    (
        # `vertices`, `bytes` and `length` are totals of the map's vertices and temporal edges, kept by each commit.
        """
        CREATE TABLE maps (
            number INTEGER PRIMARY KEY,
            id TEXT NOT NULL UNIQUE,
            environment TEXT NOT NULL,
            stamp INTEGER NOT NULL,
            robot TEXT NOT NULL,
            sensor TEXT NOT NULL,
            generation INTEGER NOT NULL,
            parent TEXT,
            finished INTEGER NOT NULL DEFAULT 0,
            vertices INTEGER NOT NULL DEFAULT 0,
            bytes INTEGER NOT NULL DEFAULT 0,
            length REAL NOT NULL DEFAULT 0
        )
        """,
        """
        CREATE TABLE vertices (
            number INTEGER PRIMARY KEY,
            map INTEGER NOT NULL REFERENCES maps ON DELETE CASCADE,
            position INTEGER NOT NULL,
            stamp INTEGER NOT NULL,
            UNIQUE (map, position)
        )
        """,
        # Apart from the vertices, so that a look at the graph reads no page of a keyframe.
        """
        CREATE TABLE keyframes (
            vertex INTEGER PRIMARY KEY REFERENCES vertices ON DELETE CASCADE,
            checksum INTEGER NOT NULL,
            content BLOB NOT NULL
        )
        """,
        """
        CREATE TABLE edges (
            a INTEGER NOT NULL REFERENCES vertices ON DELETE CASCADE,
            b INTEGER NOT NULL REFERENCES vertices ON DELETE CASCADE,
            spatial INTEGER NOT NULL,
            T_a_b BLOB NOT NULL,
            covariance BLOB NOT NULL,
            PRIMARY KEY (a, b)
        ) WITHOUT ROWID
        """,
        "CREATE INDEX edges_by_b ON edges (b)",
        """
        CREATE TABLE places (
            environment TEXT NOT NULL,
            name TEXT NOT NULL,
            vertex INTEGER NOT NULL REFERENCES vertices ON DELETE CASCADE,
            PRIMARY KEY (environment, name)
        ) WITHOUT ROWID
        """,
        "CREATE INDEX places_by_vertex ON places (vertex)",
    ),
    (
        # What recognises a place, by stream of images: descriptors of 32 bytes, one after the other.
        """
        CREATE TABLE appearances (
            vertex INTEGER NOT NULL REFERENCES vertices ON DELETE CASCADE,
            stream TEXT NOT NULL,
            descriptors BLOB NOT NULL,
            PRIMARY KEY (vertex, stream)
        )
        """,
        """
        INSERT INTO appearances (vertex, stream, descriptors)
        SELECT vertex, 'plain', found FROM (SELECT vertex, appearance_of(content, 'plain') AS found FROM keyframes)
        WHERE found IS NOT NULL
        """,
    ),
    (
        # Sharing. A map that arrives from the fleet is seen by nobody before it is whole. `sealed`: its ends are told.
        "ALTER TABLE maps ADD COLUMN start_place TEXT",
        "ALTER TABLE maps ADD COLUMN end_place TEXT",
        "ALTER TABLE maps ADD COLUMN sealed INTEGER NOT NULL DEFAULT 0",
        "ALTER TABLE maps ADD COLUMN sync TEXT NOT NULL DEFAULT 'Local'",
        "ALTER TABLE maps ADD COLUMN sync_reason TEXT NOT NULL DEFAULT ''",
        "ALTER TABLE maps ADD COLUMN used INTEGER NOT NULL DEFAULT 0",
        "ALTER TABLE maps ADD COLUMN arriving INTEGER NOT NULL DEFAULT 0",
        # Spatial edges to vertices of maps that are not here; they join when the other map comes.
        """
        CREATE TABLE waiting_edges (
            a_map TEXT NOT NULL,
            a_position INTEGER NOT NULL,
            b_map TEXT NOT NULL,
            b_position INTEGER NOT NULL,
            T_a_b BLOB NOT NULL,
            covariance BLOB NOT NULL,
            PRIMARY KEY (a_map, a_position, b_map, b_position)
        ) WITHOUT ROWID
        """,
        "CREATE INDEX waiting_edges_by_b ON waiting_edges (b_map)",
        # What repeats have to tell the fleet, until it is told.
        "CREATE TABLE reports (id TEXT PRIMARY KEY, content BLOB NOT NULL) WITHOUT ROWID",
    ),
    (
        # Whether the edge is part of the archive of the map of its end a, or b: it is if it was there at the sealing.
        # Before this version it was part of that of the younger one.
        "ALTER TABLE edges ADD COLUMN in_a INTEGER NOT NULL DEFAULT 1",
        "ALTER TABLE edges ADD COLUMN in_b INTEGER NOT NULL DEFAULT 1",
        "ALTER TABLE waiting_edges ADD COLUMN in_a INTEGER NOT NULL DEFAULT 1",
        "ALTER TABLE waiting_edges ADD COLUMN in_b INTEGER NOT NULL DEFAULT 1",
        """
        UPDATE edges SET (in_a, in_b) = (
            SELECT ma.id >= mb.id, mb.id >= ma.id FROM vertices va, vertices vb, maps ma, maps mb
            WHERE va.number = a AND vb.number = b AND ma.number = va.map AND mb.number = vb.map
        )
        """,
        "UPDATE waiting_edges SET in_a = a_map >= b_map, in_b = b_map >= a_map",
    ),
    (
        # Where the operator allows a lower speed (m/s) only, or none at all.
        """
        CREATE TABLE restrictions (
            map INTEGER NOT NULL REFERENCES maps ON DELETE CASCADE,
            first INTEGER NOT NULL,
            last INTEGER NOT NULL,
            speed REAL NOT NULL,
            reason TEXT NOT NULL,
            PRIMARY KEY (map, first)
        ) WITHOUT ROWID
        """,
    ),
)

GRAPH_TABLES = ("maps", "vertices", "edges", "places", "waiting_edges", "reports", "restrictions")
"""The tables that are checked whenever a store is opened. A keyframe has a checksum, and is checked when it is read."""


def migrate(db: sqlite3.Connection, migrations: Sequence[Migration] = MIGRATIONS) -> int:
    """Brings a store, or an empty file, to the newest version; returns the version that it had.

    Each step is a transaction: after a crash in the middle, the next opening goes on from the last whole step.
    The connection's foreign keys must be off, so that a step may rebuild a table.

    Raises:
        StoreError: the store is newer than this program, or the file is another program's database.
    """
    db.create_function("appearance_of", 2, of_old_keyframe, deterministic=True)
    found = version = version_of(db)
    if version > len(migrations):
        raise StoreError(
            f"the map store is of schema version {version} and this program knows {len(migrations)}: update the program"
        )
    while version < len(migrations):
        db.execute("BEGIN IMMEDIATE")
        try:
            # Another process may have taken this step while the lock was awaited.
            if (version := version_of(db)) < len(migrations):
                for statement in migrations[version]:
                    db.execute(statement)
                version += 1
                db.execute(f"PRAGMA user_version = {version}")
                db.execute(f"PRAGMA application_id = {APPLICATION_ID}")
            db.execute("COMMIT")
        except sqlite3.Error:
            if db.in_transaction:
                db.execute("ROLLBACK")
            raise
    return found


def version_of(db: sqlite3.Connection) -> int:
    """The version of a store's schema, 0 of an empty file.

    Raises:
        StoreError: the file is another program's database.
    """
    application, version, objects = (
        int(db.execute(question).fetchone()[0])
        for question in ("PRAGMA application_id", "PRAGMA user_version", "SELECT count(*) FROM sqlite_master")
    )
    if objects == 0 and version == 0:
        return 0
    if application != APPLICATION_ID:
        raise StoreError("the map store's file is a database of another program: move it away")
    return version
