"""The places that a finished map leads from and to, told to the store once the map is complete there."""

from __future__ import annotations

import queue
import threading
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass

import structlog

from common.errors import BusError, RetraverseError
from common.ids import VertexId
from common.messages import MapEnds, MapRecord, MapSummary
from services.navigator.questions import Questions

_NEAR_VERTICES = 5
"""A repeat that began or ended no farther than this from an end of the map that it followed has that end itself."""
_RETRY_S = 0.5
_TRIES = 20

log = structlog.get_logger()


def place_of(vertex: VertexId | None, maps: Collection[MapSummary]) -> str | None:
    """The place at which a robot stands that is at an end of a map, None where it has none."""
    for summary in maps:
        if vertex is not None and summary.record.id == vertex.map_id:
            if vertex.index == 0:
                return summary.start_place
            if vertex.index >= summary.vertices - _NEAR_VERTICES:
                return summary.end_place
    return None


@dataclass(slots=True)
class Recording:
    """A map that is recorded while another one is followed, and between which of its vertices that was."""

    record: MapRecord
    first: int | None = None
    last: int = 0

    def follows(self, trunk: VertexId) -> None:
        """The robot is at a vertex of the followed map."""
        if trunk.map_id == self.record.parent:
            self.first = trunk.index if self.first is None else self.first
            self.last = trunk.index

    def ends(self, stored: Mapping[str, MapSummary]) -> MapEnds:
        """Those of the followed map, if it was followed from one to the other."""
        followed = stored.get(self.record.parent or "")
        whole = (
            followed is not None
            and self.first is not None
            and self.first < _NEAR_VERTICES
            and self.last >= followed.vertices - _NEAR_VERTICES
        )
        if not whole or followed is None:
            return MapEnds(map=self.record.id)
        return MapEnds(map=self.record.id, start_place=followed.start_place, end_place=followed.end_place)


Ends = Callable[[Mapping[str, MapSummary]], MapEnds]
"""Tells a map's ends, of the stored maps by their ids."""


class Sealer:
    """Tells the store the ends of recorded maps, in a thread of its own; a store that is away is told later."""

    def __init__(self, questions: Questions) -> None:
        self._questions = questions
        self._waiting: queue.SimpleQueue[tuple[MapRecord, Ends]] = queue.SimpleQueue()

    def seal(self, record: MapRecord, ends: Ends) -> None:
        """Takes a map that has ended; ``ends`` tells its own, of the maps that the store has then."""
        self._waiting.put((record, ends))

    def run(self, stop: threading.Event) -> None:
        """Works until the service stops; what is left then the store shares without ends."""
        while not stop.is_set():
            try:
                record, ends = self._waiting.get(timeout=_RETRY_S)
            except queue.Empty:
                continue
            for _ in range(_TRIES):
                if self._sealed(record, ends) or stop.wait(_RETRY_S):
                    break

    def _sealed(self, record: MapRecord, ends: Ends) -> bool:
        try:
            stored = {summary.record.id: summary for summary in self._questions.maps(record.environment)}
            own = stored.get(record.id)
            if own is None or not own.finished:
                return False
            self._questions.tell_ends(ends(stored))
        except BusError:
            return False
        except RetraverseError as error:
            log.warning("the ends of a map are not kept", map=record.id, reason=str(error))
        return True
