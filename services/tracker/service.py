"""The path tracker on the bus: route and localization in, ``command/desired`` and ``tracker/status`` out."""

from __future__ import annotations

import threading
import time
from dataclasses import dataclass

import numpy as np
import structlog

from common import geometry, topics
from common.bus import Received, Subscription
from common.geometry import Array
from common.ids import VertexId
from common.messages import (
    Localization,
    Odometry,
    Route,
    SafetyStatus,
    State,
    StateName,
    TrackerStatus,
    VelocityCommand,
    WheelOdometry,
    now_ns,
)
from common.service import Service
from services.tracker.follower import PathFollower, TrackerOutput
from services.tracker.predict import StatePredictor
from services.tracker.replay import ActionReplay, Motion
from services.tracker.settings import Settings

_STATUS_PERIOD_S = 1.0 / topics.TRACKER_STATUS.rate_hz
_LONGEST_STEP_S = 0.2
_OLDEST_FRAME_S = 1.0

log = structlog.get_logger()


@dataclass(frozen=True, slots=True)
class Follow:
    """One stay in Repeat.Follow: the route's id, and the stamp since when; a resumed repeat is another one."""

    route: str
    since: int


def main(service: Service) -> None:
    """Tracks until the service is stopped."""
    Tracker(service).run()


class Tracker:
    """Follows the route that the state names; outside of Repeat.Follow it publishes its status and no command."""

    def __init__(self, service: Service) -> None:
        bus = service.bus
        self._service = service
        self._settings = service.config.settings("tracker", Settings)
        self._wake = threading.Event()
        self._state: Subscription[State] = bus.subscribe(topics.STATE, wake=self._wake)
        self._route: Subscription[Route] = bus.subscribe(topics.ROUTE, wake=self._wake)
        self._localization: Subscription[Localization] = bus.subscribe(topics.LOCALIZATION, wake=self._wake)
        self._odometry: Subscription[Odometry] = bus.subscribe(topics.ODOMETRY, wake=self._wake)
        self._wheels: Subscription[WheelOdometry] = bus.subscribe(topics.WHEEL_ODOMETRY, wake=self._wake)
        self._safe: Subscription[VelocityCommand] = bus.subscribe(topics.SAFE, wake=self._wake)
        self._safety: Subscription[SafetyStatus] = bus.subscribe(topics.SAFETY_STATUS)
        self._desired = bus.publisher(topics.DESIRED)
        self._status = bus.publisher(topics.TRACKER_STATUS)
        self._follower = PathFollower(self._settings.follower)
        limits, caution = self._settings.follower.limits, self._settings.follower.caution
        self._replay = ActionReplay(limits, caution, self._settings.replay)
        self._predictor = StatePredictor(self._settings.base)
        self._followed: Follow | None = None
        self._driven: Route | None = None
        self._end: tuple[str, VertexId] | None = None
        self._last_index = 0
        self._problem = ""
        self._last_command = 0.0
        self._status_due = 0.0

    def run(self) -> None:
        """A command after every localization, and a period after the last one."""
        self._service.ready()
        while not self._service.stop.is_set():
            self._wake.wait(max(self._last_command + self._settings.period_s - time.monotonic(), 0.0))
            self._wake.clear()
            self._take_motion()
            arrived = self._localization.poll() is not None
            now = time.monotonic()
            if arrived or now >= self._last_command + self._settings.period_s:
                with self._service.stage("cycle"):
                    self._cycle(now)
                self._last_command = now

    # --- the robot's motion ------------------------------------------------------------------------------------------

    def _take_motion(self) -> None:
        """Keeps the measured twists and the commands that reached the base, all by the monotonic clock.

        Where no wheels report, the estimator's twist takes their place.
        """
        if wheels := self._wheels.poll():
            self._predictor.odometry(wheels.arrival, wheels.message.v, wheels.message.w)
        elif (odometry := self._odometry.poll()) and self._wheels.age() > topics.WHEEL_ODOMETRY.max_age_s:
            twist = odometry.message.twist
            self._predictor.odometry(_taken_at(odometry), float(twist[0]), float(twist[5]))
        if safe := self._safe.poll():
            self._predictor.command(safe.arrival, safe.message.v, safe.message.w)

    # --- following ---------------------------------------------------------------------------------------------------

    def _cycle(self, now: float) -> None:
        state = self._state.fresh()
        if state is None or state.name is not StateName.REPEAT_FOLLOW:
            self._followed = None
            why = "no state arrives from the navigator" if state is None else f"the state is {state.name}"
            self._report(now, "", None, why)
            return
        localization = self._usable_localization(state)
        problem = self._prepare(state) or self._end_at(state)
        if not problem and localization is None:
            problem = "no localization on this route arrives"
        output: TrackerOutput | None = None
        if localization is not None and not problem:
            try:
                output = self._follow(now, localization)
            except (ValueError, ArithmeticError) as error:
                problem = f"this localization cannot be used: {error}"
        self._command(output, 0 if localization is None else localization.message.stamp)
        self._report(now, state.route, output, problem)

    def _usable_localization(self, state: State) -> Received[Localization] | None:
        received = self._localization.last()
        if received is None or received.message.route not in {state.route, state.extends or state.route}:
            return None
        age = time.monotonic() - received.arrival
        return received if age <= topics.LOCALIZATION.max_age_s else None

    def _prepare(self, state: State) -> str:
        """Begins to follow the state's route, once per stay in Repeat.Follow; returns what is in the way.

        A stay begins with what the robot does: it may still be coming to rest.
        """
        if self._followed is None:
            self._start_from(*self._present_command())
        follow = Follow(state.route, state.since)
        if self._followed == follow:
            return self._problem
        received = self._route.last()
        if received is None or received.message.id != state.route:
            return f"the route {state.route} has not arrived"
        goes_on = self._followed == Follow(state.extends, state.since)
        self._problem = self._begin(received.message, goes_on=goes_on)
        self._followed = follow
        if self._problem:
            log.error("a route cannot be followed", route=state.route, reason=self._problem)
        return self._problem

    def _begin(self, route: Route, *, goes_on: bool) -> str:
        """Takes a route; one that goes on from the present one changes nothing about how the robot drives now."""
        before, self._driven = self._driven, route
        if goes_on and (before is None or not extends(route, before)):
            return f"the route {route.id} does not begin as the one that it is said to go on from"
        length = float(np.linalg.norm(np.diff(route.path[:, :3, 3], axis=0), axis=1).sum())
        if not length <= self._settings.longest_m:
            return f"the route is {length:.4g} m long; the longest allowed is {self._settings.longest_m:g} m"
        self._end, self._last_index = None, len(route.vertices) - 1
        return self._set_path(route)

    def _end_at(self, state: State) -> str:
        """Ends the way where the robot is to pause, if the state names a vertex; returns what is in the way."""
        route = self._driven
        end = None if state.pauses_at is None else (state.route, state.pauses_at)
        if route is None or end == self._end:
            return ""
        self._end = end
        vertices = route.vertices
        if state.pauses_at is not None and state.pauses_at in vertices:
            self._last_index = vertices.index(state.pauses_at)
        else:
            self._last_index = len(vertices) - 1
        return self._set_path(route)

    def _set_path(self, route: Route) -> str:
        """Follows a route up to the vertex where it is to end; returns why it cannot be followed."""
        end = self._last_index + 1
        path, limits = route.path[:end], route.speed_limits[:end]
        try:
            with self._service.stage("route"):
                self._follower.set_route(path, limits)
                self._replay.set_route(path, limits)
        except (ValueError, ArithmeticError) as error:
            return f"the route cannot be followed: {error}"
        return ""

    def _place(self, localization: Localization) -> tuple[int, Array, Array]:
        """The vertex that the robot is at, its pose there and the covariance; none beyond the end of the way."""
        index, T = localization.trunk_index, localization.T_trunk_robot
        if self._driven is not None and self._last_index < index < len(self._driven.path):
            T = geometry.inverse(self._driven.path[self._last_index]) @ self._driven.path[index] @ T
            index = self._last_index
        return index, T, localization.covariance

    def _follow(self, now: float, received: Received[Localization]) -> TrackerOutput:
        """The command from the last localization, moved forward to when the command will act."""
        self._yield_to_safety()
        localization = received.message
        since_success = (
            localization.metres_since_success,
            localization.seconds_since_success + now - received.arrival,
        )
        dt = self._step(now)
        index, T, covariance = self._place(localization)
        if localization.actions is not None:
            motion = self._motion(now, received)
            return self._replay.update(index, T, covariance, localization.actions, motion, *since_success, dt)
        T, v, w = self._predictor.predict(T, _taken_at(received), now)
        return self._follower.update(index, T, covariance, v, w, *since_success, dt)

    def _motion(self, now: float, received: Received[Localization]) -> Motion:
        """What the robot did since the frame of a localization, and will have done when a command acts."""
        taken = _taken_at(received)
        T_frame_now, _, _ = self._predictor.predict(np.eye(4), taken, now - self._settings.base.delay)
        T_frame_acting, v, w = self._predictor.predict(np.eye(4), taken, now)
        return Motion(T_frame_now, T_frame_acting, v, w)

    def _step(self, now: float) -> float:
        """Seconds since the last command, within reason: after a long wait the next one is still a small step."""
        return min(max(now - self._last_command, 1e-3), _LONGEST_STEP_S)

    def _present_command(self) -> tuple[float, float]:
        safe = self._safe.fresh()
        return (0.0, 0.0) if safe is None else (safe.v, safe.w)

    def _start_from(self, v: float, w: float) -> None:
        """The next command, by whichever way to follow a route, is one step from this one."""
        self._follower.reset_command(v, w)
        self._replay.reset_command(v, w)

    def _yield_to_safety(self) -> None:
        """While safety holds the robot, starts from what it really does, so that no speed builds up unseen."""
        status = self._safety.fresh()
        if status is not None and not status.passing and self._safe.fresh() is not None:
            self._start_from(*self._present_command())

    # --- out ---------------------------------------------------------------------------------------------------------

    def _command(self, output: TrackerOutput | None, frame_stamp: int) -> None:
        """Sends a command; without an output it is zero, and safety shapes the stop."""
        v, w = (0.0, 0.0) if output is None else (output.v, output.w)
        if output is None:
            self._start_from(*self._present_command())
        self._desired.put(VelocityCommand(stamp=now_ns(), v=v, w=w, frame_stamp=frame_stamp))

    def _report(self, now: float, route: str, output: TrackerOutput | None, reason: str) -> None:
        """Publishes the status when it is due, and at every cycle once the end is reached."""
        finished = output is not None and output.finished
        if not finished and now < self._status_due:
            return
        self._status_due = max(self._status_due + _STATUS_PERIOD_S, now)
        self._status.put(
            TrackerStatus(
                stamp=now_ns(),
                route=route,
                lateral_error=0.0 if output is None else output.lateral_error,
                heading_error=0.0 if output is None else output.heading_error,
                arclength=0.0 if output is None else output.arclength,
                remaining=0.0 if output is None else output.remaining,
                speed_limit=self._settings.follower.limits.speed,
                finished=finished,
                reason=reason if output is None else output.reason,
            )
        )


def extends(longer: Route, route: Route) -> bool:
    """Whether a route begins with all of another one, so that a place on that is the same place on it."""
    known = len(route.vertices)
    return longer.vertices[:known] == route.vertices and bool(np.allclose(longer.path[:known], route.path, atol=1e-6))


def _taken_at(received: Received[Localization] | Received[Odometry]) -> float:
    """Monotonic time (s) at which the frame behind a message was taken.

    Its age at arrival is bounded, so that a clock that was set in between spoils one frame by a bounded amount.
    """
    wall_at_arrival = time.time() - (time.monotonic() - received.arrival)
    age = wall_at_arrival - received.message.stamp * 1e-9
    return received.arrival - min(max(age, 0.0), _OLDEST_FRAME_S)
