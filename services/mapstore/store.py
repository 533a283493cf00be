"""The robot's map store: the pose graph of every environment, in one SQLite file."""

from __future__ import annotations

import sqlite3
from collections.abc import Callable, Generator, Iterable, Sequence
from pathlib import Path
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from common.geometry import Array
from common.ids import VertexId
from common.messages import (
    AppearanceQuery,
    Appearances,
    Commit,
    Done,
    EdgeRecord,
    GraphQuery,
    MapEnds,
    MapList,
    MapRecord,
    MapSummary,
    NamePlace,
    RepeatReport,
    Restriction,
    Submap,
    SyncState,
    Topology,
    VertexRecord,
)
from services.mapstore import arrivals, commits, edges, queries, restrictions, sharing
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

    def restrict(self, wanted: Restriction) -> Done:
        """Limits the speed on a stretch of a map, blocks it, or lifts what was restricted there."""
        with self._database.writing() as db:
            restrictions.restrict(db, wanted)
        stretch = f"{wanted.map} from {wanted.first} to {wanted.last}"
        if wanted.speed is None:
            return Done(text=f"nothing is restricted on {stretch}")
        how = f"limited to {wanted.speed:g} m/s" if wanted.speed else "blocked"
        return Done(text=f"{stretch} is {how}")

    def remove(self, query: GraphQuery) -> Done:
        """Removes the map that is named, with its places; the edges between it and others wait for its return.

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

    # --- sharing -----------------------------------------------------------------------------------------------------

    def ends(self, ends: MapEnds) -> Done:
        """Keeps the places that a finished map leads from and to, after which it may be shared."""
        with self._database.writing() as db:
            sharing.seal(db, ends)
        return Done(text=f"the ends of {ends.map} are kept")

    def seal_all(self, robot: str, map_ids: Iterable[str], before_ns: int) -> None:
        """Lets maps be shared whose ends nobody told: those that are named, and those begun before a time."""
        with self._database.writing() as db:
            sharing.seal_all(db, robot, map_ids, before_ns)

    def to_share(self, robot: str) -> list[MapSummary]:
        """The robot's maps that the fleet's storage does not have, oldest first."""
        return self._read(sharing.to_share, robot)

    def set_sync(self, map_id: str, state: SyncState, reason: str = "") -> None:
        """Keeps how far a map is shared, and why no further."""
        with self._database.writing() as db:
            sharing.set_sync(db, map_id, state, reason)

    def retry(self, robot: str, map_ids: Iterable[str]) -> int:
        """Takes maps out of quarantine, those that are named or all; returns how many."""
        with self._database.writing() as db:
            return sharing.retry(db, robot, map_ids)

    def counts(self) -> tuple[int, int, int]:
        """How many maps wait to be shared, how many are, and the bytes of all maps."""
        with self._database.reading() as db:
            return sharing.counts(db)

    def touch(self, map_ids: Iterable[str]) -> None:
        """Remembers that maps are used now."""
        with self._database.writing() as db:
            sharing.touch(db, map_ids)

    def removable(self) -> list[MapSummary]:
        """Maps that are safe in the fleet's storage, the least recently used first, and halves of such maps."""
        with self._database.reading() as db:
            return sharing.removable(db)

    def make_room(self, map_id: str) -> Done:
        """Removes a map that can be fetched again."""
        return self.remove(GraphQuery(map=map_id))

    def begin_arrival(self, record: MapRecord) -> bool:
        """Makes room for a map that comes from elsewhere; False where it is here already, whole."""
        with self._database.writing() as db:
            return arrivals.begin(db, record)

    def arrive(self, vertices: Sequence[VertexRecord]) -> None:
        """Keeps the next vertices of an arriving map, which nobody sees yet."""
        with self._database.writing() as db:
            arrivals.add(db, vertices)
            self._database.require_room(db, self._settings.reserve_mb * 1e6)
            self._written += sum(array.nbytes for vertex in vertices for array in vertex.keyframe.arrays.values())

    def join_arrival(self, map_id: str, some: Sequence[EdgeRecord]) -> None:
        """Keeps some edges of an arriving map; those to maps that are not here wait for them."""
        with self._database.writing() as db:
            arrivals.join(db, map_id, some)

    def finish_arrival(self, ends: MapEnds, state: SyncState) -> MapSummary:
        """Lets everybody see an arriving map, of which all vertices and edges have come."""
        with self._database.writing() as db:
            arrivals.finish(db, ends, state)
        return self.summary(ends.map)

    def summary(self, map_id: str) -> MapSummary:
        """The summary of one map."""
        return self.maps(GraphQuery(map=map_id)).maps[0]

    def maps_of(self, environment: str) -> list[MapSummary]:
        """The maps of an environment, oldest first."""
        return self.maps(GraphQuery(environment=environment)).maps

    def whole_vertex(self, vertex: VertexId) -> VertexRecord:
        """A vertex with its keyframe and its appearance, as it was committed."""
        return self._read(queries.whole_vertex, vertex)

    def track(self, map_id: str) -> tuple[NDArray[np.int64], Array]:
        """When each vertex of a map was made, ns (N,), and the way from each to the next, (N - 1, 4, 4)."""
        return self._read(queries.track, map_id)

    def edges_of(self, map_id: str) -> Generator[EdgeRecord]:
        """The edges that are part of a map's archive, in a fixed order, from one snapshot.

        They are those that touched it when it was sealed, whether or not the maps at their other ends are here.
        """
        with self._database.reading() as db:
            yield from edges.of_map(db, queries.find_map(db, map_id).number, map_id)

    def report(self, report: RepeatReport) -> Done:
        """Keeps what a repeat has to tell the fleet."""
        with self._database.writing() as db:
            sharing.add_report(db, report)
        return Done(text=f"report {report.id} is kept")

    def reports(self, limit: int) -> list[RepeatReport]:
        """The reports that are to be told, oldest first."""
        return self._read(sharing.reports, limit)

    def drop_report(self, report: str) -> None:
        """Forgets a report that is told."""
        with self._database.writing() as db:
            sharing.drop_report(db, report)

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
