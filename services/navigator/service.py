"""The navigator: runs the state machine on the operator's commands and on what the other processes report."""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Iterator

import structlog

from common import topics
from common.bus import Received, Subscription
from common.ids import new_map_id
from common.messages import (
    Localization,
    LoopClosure,
    MapRecord,
    Odometry,
    SafetyStatus,
    State,
    StateName,
    TrackerStatus,
    now_ns,
)
from common.service import Service
from services.navigator import needs
from services.navigator.commands import Commands
from services.navigator.ends import Sealer
from services.navigator.kept import Kept
from services.navigator.machine import StateMachine
from services.navigator.mission import Deadlines, Mission, MissionRefused
from services.navigator.plans import Plans
from services.navigator.questions import Questions
from services.navigator.repeat_log import RepeatLog, Told
from services.navigator.settings import Settings

_STATE_PERIOD_S = 1.0 / topics.STATE.rate_hz
_SETTLE_S = 0.5
"""A pause lasts so long at least: the robot stands before it finds itself anew."""

log = structlog.get_logger()


def main(service: Service) -> None:
    """Runs the navigator until it is stopped."""
    Navigator(service).run()


class Navigator:
    """The state machine on the bus.

    The loop publishes the state and takes the events; commands are answered in threads of their own.
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
        self._kept = Kept(service.config.directory / "run")
        self._machine = self._make_machine()
        self._since = now_ns()
        self._published = 0.0
        self._presence = self._bus.presence(self._wake)
        self._odometry: Subscription[Odometry] = self._bus.subscribe(topics.ODOMETRY, wake=self._wake)
        self._localization: Subscription[Localization] = self._bus.subscribe(topics.LOCALIZATION, wake=self._wake)
        self._tracker: Subscription[TrackerStatus] = self._bus.subscribe(topics.TRACKER_STATUS, wake=self._wake)
        self._closures: Subscription[LoopClosure] = self._bus.subscribe(topics.LOOP_CLOSURE, wake=self._wake)
        self._safety: Subscription[SafetyStatus] = self._bus.subscribe(topics.SAFETY_STATUS, wake=self._wake)
        self._arrivals: dict[str, float] = {}
        routes = self._bus.publisher(topics.ROUTE)
        self._state = self._bus.publisher(topics.STATE)
        self._plans = Plans(self._questions, self._settings, self._changing, routes.put)
        self._sealer = Sealer(self._questions)
        self._told = Told(self._questions)
        self._log = RepeatLog(self._bus.robot, self._plans, self._sealer, self._told)
        self._commands = Commands(
            self._questions,
            self._plans,
            self._sealer,
            self._changing,
            self._check_able,
            self._environment,
            self._sensor,
            self._settings,
        )

    def run(self) -> None:
        """Publishes the state ten times a second and whenever it changes."""
        # Served first: whoever sees a state may command.
        self._bus.serve(topics.MISSION, self._commands.answer)
        stop = self._service.stop
        self._service.thread(lambda: self._plans.run(stop), "plans")
        self._service.thread(lambda: self._sealer.run(stop), "ends of maps")
        self._service.thread(lambda: self._told.run(stop), "reports")
        self._service.thread(lambda: self._kept.run(stop), "position")
        self._service.ready()
        while not self._service.stop.is_set():
            self._wake.wait(max(self._published + _STATE_PERIOD_S - time.monotonic(), 0.0))
            self._wake.clear()
            with self._service.stage("step"), self._changing() as machine:
                self._take_events(machine, time.monotonic())
            self._kept.keep_position(self._machine.mission)

    # --- state -------------------------------------------------------------------------------------------------------

    def _make_machine(self) -> StateMachine:
        limits, where, now = self._settings, self._kept.position, time.monotonic()
        return StateMachine(
            self._environment if where is None else where.environment,
            None if where is None else where.vertex,
            Deadlines(
                plan=limits.plan_s + 1.0,
                localize=limits.localize_s,
                paused=limits.paused_s,
                recover=limits.recover_s,
                merge=limits.merge_s,
                confirm=limits.confirm_s,
            ),
            self._new_map,
            now,
            self._kept.unfinished_mission(now),
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
            self._log.see(mission)
            if (mission.name, mission.since) != (before.name, before.since):
                self._since = now_ns()
                log.info("state", name=mission.name.value, reason=mission.reason)
            if mission is not before:
                self._kept.keep_mission(mission)
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
                extends=mission.extends,
                target=mission.target,
                position=mission.position,
                goal=mission.destination,
                goals=list(mission.goals),
                pauses_at=mission.pauses_at,
                candidates=list(mission.candidates),
                closure=mission.closure,
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
        if (closure := self._closures.poll()) and closure.arrival > machine.mission.since:
            machine.offered(now, closure.message)
        if status := self._tracker.poll():
            self._take_progress(machine, now, status)
        if trouble := self._trouble(machine.mission, now):
            machine.lost(now, trouble, may_recover=not self._latched())
        self._recover(machine, now)
        machine.tick(now)
        if machine.mission.name is StateName.REPEAT_PLAN and not machine.mission.attempt:
            self._plans.wake()

    def _take_progress(self, machine: StateMachine, now: float, status: Received[TrackerStatus]) -> None:
        self._arrivals["tracker/status"] = status.arrival
        message = status.message
        self._plans.progress(message.remaining)
        if status.arrival <= machine.mission.since or not message.finished:
            return
        if machine.mission.pauses_at is not None or not self._plans.ends_early(message.route):
            machine.arrived(now, message.route)

    def _recover(self, machine: StateMachine, now: float) -> None:
        """Goes on with what a pause holds once all that it needs is back; an emergency stop leaves that to a person."""
        mission = machine.mission
        if mission.resumes is None or not (mission.recovery or mission.rests):
            return
        if self._latched():
            machine.hold("the emergency stop was latched")
        elif (
            mission.recovery
            and now - mission.since > _SETTLE_S
            and not needs.missing(mission.resumes, self._presence.alive())
        ):
            machine.recovered(now)

    def _take_localization(self, machine: StateMachine, now: float, message: Localization) -> None:
        limit = self._settings.localization_s
        if machine.mission.name is StateName.REPEAT_FOLLOW:
            self._log.take(message)
            if record := self._log.next_record(machine.mission, message.trunk, self._new_map):
                machine.records(record)
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

    def _check_able(self, command: str, state: StateName) -> None:
        """Refuses a command that leads to a state which lacks a process, or that an emergency stop forbids."""
        gone = needs.missing(state, self._presence.alive())
        if gone:
            raise MissionRefused(f"cannot {command} without {needs.listed(gone)}: not running, see vtr ps")
        if self._latched():
            raise MissionRefused(f"cannot {command} while the emergency stop is latched: reset it first")
