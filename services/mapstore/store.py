"""The robot's map store: the pose graph of every environment, in one SQLite file."""

from __future__ import annotations

import sqlite3
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

from common.messages import AppearanceQuery, Appearances, Commit, Done, GraphQuery, MapList, NamePlace, Submap, Topology
from services.mapstore import commits, queries
from services.mapstore.database import Database
from services.mapstore.settings import Settings

A = TypeVar("A")
Q = TypeVar("Q")


class Store:
    """A map store, opened, and made if there is none. Any thread may ask and commit; nothing is kept in memory.

    Every method may raise a :class:`services.mapstore.errors.StoreError` where the disk or the file fails, and a
    :class:`common.errors.GraphError` where the question or the commit is wrong. Then nothing has changed.
    """

    def __init__(self, file: Path, settings: Settings | None = None) -> None:
        self._settings = settings or Settings()
        self._database = Database(file, self._settings.lock_timeout_s)
        self._written = 0

    def commit(self, commit: Commit) -> Done:
        """Makes every part of a commit durable together; parts that are stored already stay as they are.

        Raises:
            GraphError: a part contradicts what is stored: other content under an id, a vertex of an unknown or
                finished map or one that leaves a gap, an edge to an unknown vertex, a temporal edge between
                vertices that do not follow each other.
        """
        with self._database.writing() as db:
            before = db.total_changes
            commits.apply(db, commit)
            changed = db.total_changes != before
            if changed and commit.vertex is not None:
                self._database.require_room(db, self._settings.reserve_mb * 1e6)
                self._written += sum(array.nbytes for array in commit.vertex.keyframe.arrays.values())
        return Done(text="committed" if changed else "stored already")

    def name_place(self, place: NamePlace) -> Done:
        """Names a vertex as a place of its environment; naming another vertex moves the name."""
        with self._database.writing() as db:
            commits.name_place(db, place)
        return Done(text=f"'{place.place}' is {place.vertex}")

    def remove(self, query: GraphQuery) -> Done:
        """Removes the map that is named, with its places and with other maps' edges to it.

        The file does not shrink: the space is used by the maps that come.
        """
        with self._database.writing() as db:
            return Done(text=commits.remove_map(db, query))

    def maps(self, query: GraphQuery) -> MapList:
        """Summaries of every map, of an environment's, or of one, oldest first."""
        return self._read(queries.maps, query)

    def topology(self, query: GraphQuery) -> Topology:
        """An environment's whole graph without keyframes."""
        return self._read(queries.topology, query)

    def submap(self, query: GraphQuery) -> Submap:
        """Vertices with their keyframes, in the order asked for."""
        return self._read(queries.submap, query)

    def appearances(self, query: AppearanceQuery) -> Appearances:
        """What an environment's vertices look like, but for those that are known; one page of them."""
        return self._read(queries.appearances, query)

    def checkpoint(self) -> None:
        """Moves the log to the main file where enough was committed since the last time."""
        if self._written > self._settings.checkpoint_mb * 1e6:
            self._written = 0
            self._database.checkpoint()

    def close(self) -> None:
        """Ends the present commit and closes the file."""
        self._database.close()

    def _read(self, question: Callable[[sqlite3.Connection, Q], A], query: Q) -> A:
        with self._database.reading() as db:
            return question(db, query)
