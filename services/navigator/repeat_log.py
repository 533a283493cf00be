"""What is remembered of a repeat while it lasts: the maps that it records, and what it has to tell the fleet."""

from __future__ import annotations

import queue
import threading
from collections.abc import Callable

import structlog

from common import topics
from common.errors import BusError, RetraverseError
from common.ids import VertexId, new_map_id
from common.messages import Localization, MapRecord, RepeatReport, StateName, now_ns
from services.navigator.ends import Recording, Sealer
from services.navigator.feedback import Feedback
from services.navigator.mission import Mission
from services.navigator.plans import Plans
from services.navigator.questions import Questions, record_of

_RETRY_S = 0.5
_REPEATING = {StateName.REPEAT_METRIC_LOCALIZE, StateName.REPEAT_FOLLOW}

log = structlog.get_logger()

NewMap = Callable[[str, MapRecord | None], MapRecord]


class Told:
    """Hands reports to the map store, in a thread of its own; a store that is away gets them later."""

    def __init__(self, questions: Questions) -> None:
        self._questions = questions
        self._waiting: queue.SimpleQueue[RepeatReport] = queue.SimpleQueue()

    def tell(self, report: RepeatReport) -> None:
        """Takes a report."""
        self._waiting.put(report)

    def run(self, stop: threading.Event) -> None:
        """Works until the service stops."""
        while not stop.is_set():
            try:
                report = self._waiting.get(timeout=_RETRY_S)
            except queue.Empty:
                continue
            while not self._accepted(report) and not stop.wait(_RETRY_S):
                pass

    def _accepted(self, report: RepeatReport) -> bool:
        try:
            self._questions.tell(report)
        except BusError:
            return False
        except RetraverseError as error:
            log.warning("a report of a repeat is not kept", reason=str(error))
        return True


class RepeatLog:
    """Follows the missions, and what is localized in them; asked under the state machine's lock alone."""

    def __init__(self, robot: str, plans: Plans, sealer: Sealer, told: Told) -> None:
        self._robot = robot
        self._plans = plans
        self._sealer = sealer
        self._told = told
        self._recording: Recording | None = None
        self._feedback: Feedback | None = None
        self._route = ""

    def see(self, mission: Mission) -> None:
        """Hears what the robot is doing now."""
        state = mission.resumes or mission.name
        repeats = state in _REPEATING
        record = mission.map if repeats else None
        if self._recording is not None and (record is None or record.id != self._recording.record.id):
            self._sealer.seal(self._recording.record, self._recording.ends)
            self._recording = None
        if record is not None and self._recording is None:
            self._recording = Recording(record)
        if repeats and mission.route != self._route:
            self._follow(mission)
        elif not repeats and self._feedback is not None:
            self._end(arrived=mission.reason.startswith("reached"))

    def take(self, message: Localization) -> None:
        """Hears where the robot is on its route."""
        if self._feedback is not None:
            self._feedback.take(message)
        if self._recording is not None and message.success:
            self._recording.follows(message.trunk)

    def next_record(self, mission: Mission, trunk: VertexId, new_map: NewMap) -> MapRecord | None:
        """The record of another map to go on recording in, where the robot follows another one than before."""
        if mission.map is None or trunk.map_id == mission.map.parent:
            return None
        followed = record_of(trunk.map_id, self._plans.maps)
        return None if followed is None else new_map(mission.environment, followed)

    def _follow(self, mission: Mission) -> None:
        route = self._plans.route
        if route is None or route.id != mission.route:
            return
        if self._feedback is None:
            stamp = now_ns()
            name = new_map_id(self._robot, stamp).lower()
            period = 1.0 / topics.LOCALIZATION.rate_hz
            self._feedback = Feedback(name, self._robot, mission.environment, stamp, period)
        self._route = mission.route
        self._feedback.follow(route)

    def _end(self, *, arrived: bool) -> None:
        report = None if self._feedback is None else self._feedback.report(arrived=arrived)
        self._feedback, self._route = None, ""
        if report is not None:
            self._told.tell(report)
