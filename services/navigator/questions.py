"""What the navigator asks of the map store and of the estimator while it answers a command."""

from __future__ import annotations

import contextlib
import threading
import time

from common import topics
from common.bus import Bus
from common.errors import RetraverseError
from common.ids import VertexId
from common.messages import (
    Commit,
    Done,
    GraphQuery,
    MapEnds,
    MapList,
    MapRecord,
    MapSummary,
    NamePlace,
    PlanRequest,
    Relocalization,
    Relocalize,
    RepeatReport,
    Restriction,
    Route,
)
from services.navigator.mission import MissionRefused
from services.navigator.settings import Settings

_STORE_POLL_S = 0.1


class Questions:
    """Questions on the bus, each with its deadline; an error of the bus passes through unless said otherwise."""

    def __init__(self, bus: Bus, settings: Settings, stop: threading.Event) -> None:
        self._bus = bus
        self._settings = settings
        self._stop = stop

    def maps(self, environment: str) -> list[MapSummary]:
        """The stored maps of an environment, oldest first."""
        answer: MapList = self._bus.ask(
            topics.MAPS, GraphQuery(environment=environment), timeout=self._settings.store_s
        )
        return answer.maps

    def await_finished(self, record: MapRecord) -> MapSummary:
        """The map in the store, once the estimator has finished it there.

        Raises:
            MissionRefused: it is not there, or not whole, within the setting ``finish_s``.
        """
        deadline = time.monotonic() + self._settings.finish_s
        found: MapSummary | None = None
        while time.monotonic() < deadline and not self._stop.is_set():
            with contextlib.suppress(RetraverseError):  # a store that is started anew answers a moment later
                found = next((m for m in self.maps(record.environment) if m.record.id == record.id), None)
            if found is not None and found.finished:
                return found
            self._stop.wait(_STORE_POLL_S)
        wait = f"{self._settings.finish_s:g} s"
        if found is None:
            raise MissionRefused(
                f"the store has no vertex of map {record.id} after {wait}: did the estimator see any frame?"
            )
        raise MissionRefused(f"map {record.id} is not complete in the store after {wait}; see the estimator's log")

    def name_place(self, environment: str, place: str, vertex: VertexId) -> None:
        """Names a vertex of a map that was stored just now.

        Raises:
            MissionRefused: the store refuses, or does not answer.
        """
        question = NamePlace(environment=environment, place=place, vertex=vertex)
        try:
            self._bus.ask(topics.NAME_PLACE, question, timeout=self._settings.store_s)
        except RetraverseError as error:
            raise MissionRefused(f"the map is stored, but '{place}' could not be named: {error}") from None

    def commit(self, commit: Commit) -> None:
        """Makes a part of the graph durable."""
        self._bus.ask(topics.COMMIT, commit, timeout=self._settings.store_s)

    def restrict(self, restriction: Restriction) -> Done:
        """Has the store keep a restriction; its answer says what holds now."""
        answer: Done = self._bus.ask(topics.RESTRICT, restriction, timeout=self._settings.store_s)
        return answer

    def tell_ends(self, ends: MapEnds) -> None:
        """Tells the store what a finished map leads from and to, after which it may be shared."""
        self._bus.ask(topics.ENDS, ends, timeout=self._settings.store_s)

    def tell(self, report: RepeatReport) -> None:
        """Hands the store what a repeat has to tell the fleet."""
        self._bus.ask(topics.REPORT, report, timeout=self._settings.store_s)

    def route(self, request: PlanRequest) -> Route:
        """The planner's answer."""
        answer: Route = self._bus.ask(topics.PLAN, request, timeout=self._settings.plan_s)
        return answer

    def where(self, environment: str) -> Relocalization:
        """Where the estimator finds the robot, of whose place nothing is known."""
        question = Relocalize(environment=environment)
        answer: Relocalization = self._bus.ask(topics.RELOCALIZE, question, timeout=self._settings.relocalize_s)
        return answer


def exists(vertex: VertexId, maps: list[MapSummary]) -> bool:
    """Whether one of the maps has a vertex."""
    return any(m.record.id == vertex.map_id and 0 <= vertex.index < m.vertices for m in maps)


def check_exists(vertex: VertexId, maps: list[MapSummary], environment: str) -> None:
    """Refuses a vertex that no map of an environment has.

    Raises:
        MissionRefused: none has.
    """
    if not exists(vertex, maps):
        raise MissionRefused(f"environment '{environment}' has no vertex {vertex}")


def record_of(map_id: str, maps: list[MapSummary]) -> MapRecord | None:
    """The record of a map, None where the maps have none of its id."""
    return next((m.record for m in maps if m.record.id == map_id), None)
