"""The store's SQLite file: one writing connection, as many reading ones as are needed, and durable transactions."""

from __future__ import annotations

import contextlib
import os
import shutil
import sqlite3
import threading
from collections import deque
from collections.abc import Iterator
from pathlib import Path

from services.mapstore.errors import StoreError, store_error
from services.mapstore.schema import GRAPH_TABLES, migrate

_PAGE_BYTES = 8192
"""Twice SQLite's default: a keyframe of 150 kB then takes 19 pages; larger ones gain nothing more."""

_PRAGMAS = ("synchronous = FULL", "wal_autocheckpoint = 0", "secure_delete = 0")
"""Some distributions' SQLite overwrites what is removed: a removal would then need as much free disk as the map has."""


class Database:
    """A map store's file, opened, checked and of this program's version; its methods may be called by any thread.

    In WAL mode readers see the last committed state while a commit is being written. ``synchronous=FULL`` makes
    COMMIT return when the log is on the disk. SQLite's automatic checkpoint is off, since it would make one commit in
    some thirty wait for 4 MB to be moved: :meth:`checkpoint` does that from another thread.

    Raises:
        StoreError: the file cannot be opened or created, is damaged, newer than this program, or another program's.
    """

    def __init__(self, file: Path, lock_timeout_s: float) -> None:
        self.file = file
        self._lock_timeout_s = lock_timeout_s
        self._lock = threading.Lock()
        self._readers: deque[sqlite3.Connection] = deque()
        self._closed = False
        with self._translated():
            _make_durable_folder(file.parent)
            self._writer = self._open_writer()
            self._tidier = self._connect()
            self._identity = _identity(file)

    @contextlib.contextmanager
    def writing(self) -> Iterator[sqlite3.Connection]:
        """A transaction that is durable when the block has ended, and has left no trace if the block raised.

        Raises:
            StoreError: the disk is full, the store locked, damaged, moved away or closed.
        """
        with self._lock, self._translated():
            self._require_file()
            self._writer.execute("BEGIN IMMEDIATE")
            try:
                yield self._writer
                self._writer.execute("COMMIT")
            finally:
                # SQLite itself has rolled back where, for instance, the disk was full.
                if self._writer.in_transaction:
                    self._writer.execute("ROLLBACK")

    @contextlib.contextmanager
    def reading(self) -> Iterator[sqlite3.Connection]:
        """A snapshot: every question within the block is answered from one committed state.

        Raises:
            StoreError: the store is damaged, moved away or closed.
        """
        with self._translated():
            self._require_file()
            try:
                db = self._readers.pop()
            except IndexError:
                db = self._connect("query_only = 1")
            try:
                db.execute("BEGIN")
                yield db
            finally:
                if db.in_transaction:
                    db.execute("COMMIT")
                self._readers.append(db)

    def require_room(self, db: sqlite3.Connection, reserve_bytes: float) -> None:
        """Asks, within a transaction, whether what it wrote leaves ``reserve_bytes`` of the disk free.

        Pages that removed maps have left in the file count as free.

        Raises:
            StoreError: it does not.
        """
        (pages,) = db.execute("PRAGMA freelist_count").fetchone()
        left = shutil.disk_usage(self.file.parent).free + pages * _PAGE_BYTES
        if left < reserve_bytes:
            raise StoreError(
                f"the disk of the map store {self.file} is nearly full: {left / 1e6:.0f} MB are left and "
                f"{reserve_bytes / 1e6:.0f} MB are kept free: remove maps (vtr maps rm), or free some space"
            )

    def checkpoint(self) -> None:
        """Moves what the log holds to the main file, beside readers and commits, so that the log is used anew.

        Raises:
            StoreError: the disk is full or fails; the log keeps what it has.
        """
        with self._translated():
            self._tidier.execute("PRAGMA wal_checkpoint(PASSIVE)").fetchall()

    def close(self) -> None:
        """Ends every connection once the present commit is done; the log is moved to the main file."""
        with self._lock, self._translated():
            self._closed = True
            while self._readers:
                self._readers.pop().close()
            self._tidier.close()
            self._writer.close()

    def _open_writer(self) -> sqlite3.Connection:
        db = self._connect(f"page_size = {_PAGE_BYTES}")
        try:
            # Before anything is written: a file that is refused stays as it is.
            migrate(db)
            db.execute("PRAGMA journal_mode = WAL")
            self._require_sound(db)
            db.execute("PRAGMA foreign_keys = 1")
        except BaseException:
            db.close()
            raise
        return db

    def _connect(self, *pragmas: str) -> sqlite3.Connection:
        timeout = self._lock_timeout_s
        db = sqlite3.connect(self.file, timeout=timeout, isolation_level=None, check_same_thread=False)
        for pragma in (*pragmas, *_PRAGMAS):
            db.execute(f"PRAGMA {pragma}")
        return db

    def _require_sound(self, db: sqlite3.Connection) -> None:
        for table in GRAPH_TABLES:
            found = db.execute(f"PRAGMA quick_check({table})").fetchone()[0]
            if found != "ok":
                raise StoreError(f"the map store {self.file} is damaged: move it away, or restore a copy of it")

    def _require_file(self) -> None:
        """Refuses to go on with a file that has lost its name: what is written there would be gone."""
        if self._closed:
            raise StoreError("the map store is closing")
        if _identity(self.file) != self._identity:
            raise StoreError(f"the map store {self.file} was moved away while in use: restart the process mapstore")

    @contextlib.contextmanager
    def _translated(self) -> Iterator[None]:
        try:
            yield
        except (sqlite3.Error, OSError) as error:
            raise store_error(self.file, error) from error


def _identity(file: Path) -> tuple[int, int]:
    status = file.stat()
    return status.st_dev, status.st_ino


def _make_durable_folder(folder: Path) -> None:
    """Makes a folder and those above it, and waits until the disk knows their names."""
    missing = [path for path in (folder, *folder.parents) if not path.exists()]
    folder.mkdir(parents=True, exist_ok=True)
    for path in missing:
        handle = os.open(path.parent, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)
