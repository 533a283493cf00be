"""What can be wrong with the store itself, as against what is asked of it."""

from __future__ import annotations

import sqlite3

from common.errors import Unavailable

_DAMAGED = {sqlite3.SQLITE_CORRUPT, sqlite3.SQLITE_NOTADB}
_HELD = {sqlite3.SQLITE_BUSY, sqlite3.SQLITE_LOCKED}
_PRIMARY_CODE = 0xFF


class StoreError(Unavailable):
    """The store cannot be opened, read or written now; nothing was changed, and the same may be asked again later."""


def store_error(file: object, error: sqlite3.Error | OSError) -> StoreError:
    """The sentence for an error of SQLite or of the file system at the store's file."""
    code = getattr(error, "sqlite_errorcode", 0) & _PRIMARY_CODE
    if code == sqlite3.SQLITE_FULL:
        return StoreError(f"the disk of the map store {file} is full: free some space on it")
    if code in _HELD:
        return StoreError(f"the map store {file} is locked by another process: end that one, then try again")
    if code in _DAMAGED:
        return StoreError(f"the map store {file} is damaged ({error}): move it away, or restore a copy of it")
    if isinstance(error, OSError):
        return StoreError(f"the map store {file} cannot be used: {error.strerror}: check its folder's owner and rights")
    return StoreError(f"the map store {file} cannot be read or written: {error}")
