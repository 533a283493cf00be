"""The navigator: runs the state machine on the operator's commands and on what the other processes report."""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import structlog

from common import topics
from common.bus import Subscription
from common.errors import RetraverseError
from common.ids import VertexId, new_map_id
from common.messages import (
    Command,
    Done,
    Localization,
    MapRecord,
    MapSummary,
    Odometry,
    PlanRequest,
    Route,
    SafetyStatus,
    State,
    StateName,
    TrackerStatus,
    now_ns,
)
from common.service import Service
from services.navigator import needs, position
from services.navigator.machine import Deadlines, Mission, MissionRefused, StateMachine
from services.navigator.position import Position
from services.navigator.questions import Questions, check_exists, exists, record_of
from services.navigator.settings import Settings

_STATE_PERIOD_S = 1.0 / topics.STATE.rate_hz
_SAVE_PERIOD_S = 1.0

log = structlog.get_logger()


@dataclass(frozen=True, slots=True)
class _Start:
    """The vertex that a mission starts at; where there is none, why."""

    vertex: VertexId | None
    remark: str = ""


def main(service: Service) -> None:
    """Runs the navigator until it is stopped."""
    Navigator(service).run()


class Navigator:
    """The state machine on the bus.

    The loop publishes the state and takes the events; commands are answered in a thread of their own. An answer that
    has to wait, for a plan or for the store, waits there, and only in Repeat.Plan or Idle, where the robot stands.
    """

    def __init__(self, service: Service) -> None:
        self._service = service
        self._bus = service.bus
        self._settings = service.config.settings("navigator", Settings)
        self._questions = Questions(service.bus, self._settings, service.stop)
        self._environment = service.config.robot.environment
        self._sensor = service.config.robot.sensor
        self._lock = threading.Lock()
        self._wake = threading.Event()
        self._path = service.config.directory / "run" / "position.json"
        self._saved = self._load_position()
        self._save_due = 0.0
        self._machine = self._make_machine()
        self._since = now_ns()
        self._published = 0.0
        self._presence = self._bus.presence(self._wake)
        self._odometry: Subscription[Odometry] = self._bus.subscribe(topics.ODOMETRY, wake=self._wake)
        self._localization: Subscription[Localization] = self._bus.subscribe(topics.LOCALIZATION, wake=self._wake)
        self._tracker: Subscription[TrackerStatus] = self._bus.subscribe(topics.TRACKER_STATUS, wake=self._wake)
        self._safety: Subscription[SafetyStatus] = self._bus.subscribe(topics.SAFETY_STATUS, wake=self._wake)
        self._arrivals: dict[str, float] = {}
        self._route = self._bus.publisher(topics.ROUTE)
        self._state = self._bus.publisher(topics.STATE)
        self._handlers: dict[str, Callable[[Command], str]] = {
            "teach": self._teach,
            "finish": self._finish,
            "repeat": self._repeat,
            "pause": self._pause,
            "resume": self._resume,
            "cancel": self._cancel,
            "position": self._stand_at,
        }

    def run(self) -> None:
        """Publishes the state ten times a second and whenever it changes."""
        # Served first: whoever sees a state may command.
        self._bus.serve(topics.MISSION, self._answer)
        self._service.ready()
        while not self._service.stop.is_set():
            self._wake.wait(max(self._published + _STATE_PERIOD_S - time.monotonic(), 0.0))
            self._wake.clear()
            with self._service.stage("step"), self._changing() as machine:
                self._take_events(machine, time.monotonic())
            self._save_position()

    # --- state -------------------------------------------------------------------------------------------------------

    def _make_machine(self) -> StateMachine:
        limits = self._settings
        where = self._saved
        return StateMachine(
            self._environment if where is None else where.environment,
            None if where is None else where.vertex,
            Deadlines(plan=limits.plan_s + 1.0, localize=limits.localize_s, paused=limits.paused_s),
            self._new_map,
            time.monotonic(),
        )

    def _new_map(self, environment: str, repeated: MapRecord | None) -> MapRecord:
        robot, stamp = self._bus.robot, now_ns()
        return MapRecord(
            id=new_map_id(robot, stamp),
            environment=environment,
            stamp=stamp,
            robot=robot,
            sensor=self._sensor,
            generation=0 if repeated is None else repeated.generation + 1,
            parent=None if repeated is None else repeated.id,
        )

    @contextlib.contextmanager
    def _changing(self) -> Iterator[StateMachine]:
        """The machine, for one thread at a time; the state is published if it changed or is due."""
        with self._lock:
            before = self._machine.mission
            yield self._machine
            mission = self._machine.mission
            if (mission.name, mission.since) != (before.name, before.since):
                self._since = now_ns()
                log.info("state", name=mission.name.value, reason=mission.reason)
            if mission is not before or time.monotonic() >= self._published + _STATE_PERIOD_S:
                self._publish(mission)

    def _publish(self, mission: Mission) -> None:
        self._published = time.monotonic()
        self._state.put(
            State(
                stamp=now_ns(),
                name=mission.name,
                environment=mission.environment,
                since=self._since,
                reason=mission.reason,
                waiting_for=mission.waiting_for,
                resumes=mission.resumes,
                map=mission.map,
                route=mission.route,
                target=mission.target,
                position=mission.position,
                goal=mission.goal,
            )
        )

    # --- events ------------------------------------------------------------------------------------------------------

    def _take_events(self, machine: StateMachine, now: float) -> None:
        """Hands the machine what arrived since the present state was entered; older samples belong to another one."""
        if received := self._odometry.poll():
            self._arrivals["odometry"] = received.arrival
            if received.arrival > machine.mission.since and received.message.vertex is not None:
                machine.made_vertex(received.message.vertex)
        if located := self._localization.poll():
            self._arrivals["localization"] = located.arrival
            if located.arrival > machine.mission.since:
                self._take_localization(machine, now, located.message)
        if status := self._tracker.poll():
            self._arrivals["tracker/status"] = status.arrival
            if status.arrival > machine.mission.since and status.message.finished:
                machine.arrived(now, status.message.route)
        if trouble := self._trouble(machine.mission, now):
            machine.lost(now, trouble)
        machine.tick(now)

    def _take_localization(self, machine: StateMachine, now: float, message: Localization) -> None:
        limit = self._settings.localization_s
        if message.success:
            machine.localized(now, message.route, message.trunk)
        elif machine.mission.name is StateName.REPEAT_FOLLOW and message.seconds_since_success > limit:
            machine.lost(now, f"lost: not localized for {message.seconds_since_success:.0f} s ({message.reason})")

    def _trouble(self, mission: Mission, now: float) -> str:
        """What the present state needs and has lost, in words; empty if nothing."""
        if self._latched():
            # So a reset alone sets nothing in motion: the operator has to resume as well.
            return "the emergency stop is latched"
        gone = needs.missing(mission.name, self._present(mission.since))
        if gone:
            return f"lost {needs.listed(gone) if self._bus.connected() else 'the router'}"
        gap, first = self._settings.data_s, self._settings.first_data_s
        quiet = needs.silent(mission.name, mission.since, now, self._arrivals, first, gap)
        return f"nothing arrives any longer on {needs.listed(quiet)}" if quiet else ""

    def _latched(self) -> bool:
        status = self._safety.last()
        return status is not None and status.message.latched

    def _present(self, since: float) -> frozenset[str]:
        """The processes that have been there all the time since; one that was started anew has forgotten its part."""
        alive = self._presence.alive()
        return frozenset(name for name in alive if (self._presence.since(name) or float("inf")) <= since)

    # --- commands ----------------------------------------------------------------------------------------------------

    def _answer(self, command: Command) -> Done:
        return Done(text=self._handlers[command.action](command))

    def _teach(self, command: Command) -> str:
        environment = command.environment or self._environment
        self._check_startable("teach", StateName.TEACH_METRIC_LOCALIZE)
        start = self._start(command, environment, self._questions.maps(environment))
        with self._changing() as machine:
            machine.teach(time.monotonic(), environment, start.vertex, command.start_place)
            remark = f" ({start.remark})" if start.remark else ""
            return f"teaching: {machine.mission.reason}{remark}"

    def _finish(self, command: Command) -> str:
        with self._changing() as machine:
            taught = machine.finish(time.monotonic())
        if taught.map is None:  # the table lets a map be finished only where there is one
            raise MissionRefused("no map was being taught")
        stored = self._questions.await_finished(taught.map)
        ends = {command.start_place or taught.start_place: 0, command.end_place: stored.vertices - 1}
        for place, index in ends.items():
            if place is not None:
                self._questions.name_place(taught.environment, place, VertexId(taught.map.id, index))
        return f"map {taught.map.id} is stored: {stored.vertices} vertices, {stored.length:.1f} m"

    def _repeat(self, command: Command) -> str:
        environment = command.environment or self._environment
        self._check_startable("repeat", StateName.REPEAT_PLAN)
        if not command.goal:
            raise MissionRefused("a repeat needs a goal: a place, a map, or a vertex as map:index")
        maps = self._questions.maps(environment)
        if not any(m.record.generation == 0 for m in maps):
            raise MissionRefused(f"environment '{environment}' has no map that could be repeated: teach one first")
        start = self._start(command, environment, maps)
        if start.vertex is None:
            raise MissionRefused(
                f"it is unknown where the robot stands in '{environment}': name its vertex ({start.remark})"
            )
        with self._changing() as machine:
            attempt = machine.repeat(time.monotonic(), environment, start.vertex, command.goal)
        wanted = self._settings.record_repeats if command.record is None else command.record
        request = PlanRequest(environment=environment, start=start.vertex, goal=command.goal)
        return self._plan(attempt, request, maps if wanted else [])

    def _plan(self, attempt: int, request: PlanRequest, recordable: list[MapSummary]) -> str:
        """Asks for the route and hands it on; the repeat is recorded if its first map is among the recordable ones."""
        try:
            route: Route = self._bus.ask(topics.PLAN, request, timeout=self._settings.plan_s)
        except RetraverseError as error:
            with self._changing() as machine:
                machine.not_planned(time.monotonic(), attempt, f"no route to {request.goal}: {error}")
            raise
        text = f"{route.length:.1f} m to {request.goal}: {route.reason}"
        # The route goes first, so that whoever sees the state that names it has it.
        self._route.put(route)
        repeated = record_of(route.vertices[0].map_id, recordable)
        with self._changing() as machine:
            if not machine.planned(time.monotonic(), attempt, route.id, route.vertices[0], text, repeated):
                raise MissionRefused(f"the plan came too late: the robot is {machine.mission.doing}")
        return text

    def _pause(self, _command: Command) -> str:
        with self._changing() as machine:
            machine.pause(time.monotonic())
            return f"the robot is {machine.mission.doing}"

    def _resume(self, _command: Command) -> str:
        with self._changing() as machine:
            machine.check("resume")
            resumes = machine.mission.resumes
            self._check_present("resume", resumes or StateName.IDLE)
            machine.resume(time.monotonic())
            return f"the robot is {machine.mission.doing}"

    def _cancel(self, _command: Command) -> str:
        with self._changing() as machine:
            machine.cancel(time.monotonic())
            return f"the robot is {machine.mission.doing}"

    def _stand_at(self, command: Command) -> str:
        environment = command.environment or self._environment
        if (command.vertex is None) != command.find:
            raise MissionRefused("a position is a vertex, written as map:index, or is to be found by the robot itself")
        with self._changing() as machine:
            machine.check("position")
        vertex, remark = command.vertex, ""
        if vertex is None:
            found = self._questions.where(environment)
            vertex, remark = found.vertex, f": {found.inliers} landmarks agree"
        check_exists(vertex, self._questions.maps(environment), environment)
        with self._changing() as machine:
            machine.stand_at(environment, vertex)
        return f"the robot stands at {vertex}{remark}"

    # --- what commands ask for ---------------------------------------------------------------------------------------

    def _check_startable(self, command: str, state: StateName) -> None:
        with self._changing() as machine:
            machine.check(command)
        self._check_present(command, state)

    def _check_present(self, command: str, state: StateName) -> None:
        gone = needs.missing(state, self._presence.alive())
        if gone:
            raise MissionRefused(f"cannot {command} without {needs.listed(gone)}: not running, see vtr ps")
        if self._latched():
            raise MissionRefused(f"cannot {command} while the emergency stop is latched: reset it first")

    def _start(self, command: Command, environment: str, maps: list[MapSummary]) -> _Start:
        """Where the robot stands: by the operator's word, else as it is known, else as the estimator finds it."""
        if command.vertex is not None:
            check_exists(command.vertex, maps, environment)
            return _Start(command.vertex)
        mission = self._machine.mission
        if mission.environment == environment and mission.position is not None and exists(mission.position, maps):
            return _Start(mission.position)
        if not maps:
            return _Start(None)
        try:
            found = self._questions.where(environment)
        except RetraverseError as error:
            return _Start(None, f"it did not find itself: {error}")
        log.info("the robot found itself", vertex=str(found.vertex), inliers=found.inliers)
        return _Start(found.vertex)

    # --- position file -----------------------------------------------------------------------------------------------

    def _load_position(self) -> Position | None:
        try:
            return position.load(self._path)
        except position.PositionUnreadable as error:
            log.warning(str(error))
            return None

    def _save_position(self) -> None:
        """Keeps the position in its file, at most once a second."""
        now, mission = time.monotonic(), self._machine.mission
        known = None if mission.position is None else Position(mission.environment, mission.position)
        if known == self._saved or now < self._save_due:
            return
        self._save_due = now + _SAVE_PERIOD_S
        try:
            position.save(self._path, known)
        except OSError as error:
            log.warning("the position cannot be kept", path=str(self._path), reason=error.strerror)
        else:
            self._saved = known
