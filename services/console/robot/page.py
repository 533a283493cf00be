"""The robot's page: wires its models to the bus."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from common import topics
from common.bus import Received, Subscription
from common.errors import RetraverseError
from common.messages import (
    Health,
    Joystick,
    Localization,
    MapRecord,
    Odometry,
    Route,
    SafetyStatus,
    State,
    TrackerStatus,
    VelocityCommand,
    now_ns,
)
from common.service import Service
from services.console.errors import BadArguments
from services.console.page import Page, Resource
from services.console.robot.actions import Actions, vertex_of
from services.console.robot.backgrounds import Backgrounds
from services.console.robot.camera_feed import CameraFeed
from services.console.robot.fetcher import GraphFetcher
from services.console.robot.models import mission, permits, telemetry
from services.console.robot.models.graph import GraphModel
from services.console.robot.models.health import Processes
from services.console.robot.models.layout import Plane, planar
from services.console.robot.models.teleop import Teleop, Velocity
from services.console.robot.models.timeline import Event, Timeline
from services.console.settings import Settings

_SERIES_S = 0.2
_MERGE_M = 8.0
_MERGE_MOST = 48
_BACKGROUND = "background/"


class RobotPage(Page):
    """One robot: where it is, what it does and why, and an operator's commands."""

    name = "robot"
    title = "Robot"
    folder = Path(__file__).parent / "static"

    def __init__(self, service: Service, settings: Settings) -> None:
        super().__init__(service, settings)
        bus = service.bus
        self._presence = bus.presence()
        self._states: Subscription[State] = bus.subscribe(topics.STATE)
        self._routes: Subscription[Route] = bus.subscribe(topics.ROUTE)
        self._safety: Subscription[SafetyStatus] = bus.subscribe(topics.SAFETY_STATUS)
        self._odometry: Subscription[Odometry] = bus.subscribe(topics.ODOMETRY)
        self._localization: Subscription[Localization] = bus.subscribe(topics.LOCALIZATION)
        self._tracker: Subscription[TrackerStatus] = bus.subscribe(topics.TRACKER_STATUS)
        self._health: Subscription[Health] = bus.subscribe(topics.HEALTH)
        self._teleop_out = bus.publisher(topics.TELEOP)
        self._joystick_out = bus.publisher(topics.JOYSTICK)
        self._graph = GraphModel(self.channel)
        self._fetcher = GraphFetcher(bus)
        self._processes = Processes()
        self._timeline = Timeline()
        self._teleop = Teleop(settings.speed, settings.turn_rate)
        self._camera = CameraFeed(bus, service.config.robot.sensor, self.channel, settings)
        self._actions = Actions(bus, lambda: self._environment)
        self._backgrounds = _backgrounds(service, settings)
        self._environment = service.config.robot.environment
        self._state: State | None = None
        self._latched = False
        self._refused: dict[str, str] = {}
        self._last_odometry: Odometry | None = None
        self._series_due = 0.0
        self._arrival = 0.0
        self._lock = threading.Lock()
        self.channel.set("robot", self._about())
        service.thread(lambda: self._fetcher.run(service.stop), "graph")

    # --- what is shown -----------------------------------------------------------------------------------------------

    def update(self, now: float) -> None:
        """Shows what has arrived."""
        self._take_states()
        self._take_safety()
        self._take_health()
        self._take_graph()
        self._take_motion(now)
        self._camera.update(now)
        self._refused = permits.refusals(self._situation())
        self.channel.set("refused", self._refused)
        self.channel.set("driver", self._teleop.held(now))

    def _about(self) -> dict[str, Any]:
        robot = self.service.config.robot
        return {
            "name": robot.name,
            "sensor": robot.sensor,
            "speed": self.settings.speed,
            "turn_rate": self.settings.turn_rate,
        }

    def _take_states(self) -> None:
        while received := self._states.poll():
            self._heard(received)
            state, before = received.message, self._state
            self._state, self._environment = state, state.environment
            self._tell(self._timeline.state(state))
            changed = before is None or (before.name, before.map) != (state.name, state.map)
            if changed:
                self._fetcher.wake()
            self.channel.set("state", mission.state_section(state))
        self._fetcher.look_at(self._environment)
        while route := self._routes.poll():
            self._heard(route)
            self.channel.set("route", mission.route_section(route.message))

    def _take_safety(self) -> None:
        while received := self._safety.poll():
            self._heard(received)
            self._latched = received.message.latched
            self._tell(self._timeline.safety(received.message))
            self.channel.set("safety", mission.safety_section(received.message))

    def _take_health(self) -> None:
        while received := self._health.poll():
            self._processes.take(received.message, received.arrival)
        present = self._presence.alive()
        self._tell(self._timeline.presence(present))
        extra = [name for name in ("obstacles",) if name in self.service.config.tables]
        for name, row in self._processes.rows(present - {"operator"}, extra).items():
            self.channel.set(f"process/{name}", row)

    def _take_graph(self) -> None:
        if (drawn := self._fetcher.newest()) is not None:
            self._graph.take(drawn)
            self.channel.set("background", self._backgrounds.section(self._environment))

    def _take_motion(self, now: float) -> None:
        while odometry := self._odometry.poll():
            self._heard(odometry)
            self._grow(odometry.message)
        while found := self._localization.poll():
            self._heard(found)
            self._tell(self._timeline.localization(found.message))
        if tracked := self._tracker.last():
            self._heard(tracked)
        state = self._state
        heard = telemetry.Heard(
            arrival=self._arrival,
            odometry=self._odometry.fresh(),
            localization=self._localization.fresh(),
            tracker=self._tracker.fresh(),
            position=None if state is None else state.position,
        )
        live = telemetry.live_section(heard, self._graph)
        sample = telemetry.series_sample(live)
        if sample is not None and now >= self._series_due:
            self._series_due = now + _SERIES_S
            self.channel.append("series", sample)
        self.channel.set("live", live)

    def _grow(self, odometry: Odometry) -> None:
        """Draws a vertex as soon as odometry is told from it: where the robot was then."""
        before, self._last_odometry = self._last_odometry, odometry
        vertex, record = odometry.vertex, None if self._state is None else self._state.map
        if vertex is None or record is None or vertex.map_id != record.id:
            return
        if self._graph.pose(vertex) is None and (pose := self._where_it_was(before, record)) is not None:
            self._graph.grow(record, vertex, pose)

    def _where_it_was(self, before: Odometry | None, record: MapRecord) -> Plane | None:
        if before is not None and before.vertex is not None:
            found = self._graph.place(before.vertex, planar(before.T_vertex_robot))
            if found is not None:
                return found
        return np.zeros(3) if self._graph.is_empty(but=record.id) else None

    def _heard(self, received: Received[Any]) -> None:
        self._arrival = max(self._arrival, received.arrival)
        self._processes.hear(received.source.process, received.arrival)

    def _tell(self, events: Iterable[Event]) -> None:
        for event in events:
            self.channel.append("events", event.section(now_ns() // 1_000_000))

    def _situation(self) -> permits.Situation:
        stale = self._states.age() > topics.STATE.max_age_s * 4
        return permits.Situation(
            state=None if stale else self._state,
            present=self._presence.alive(),
            latched=self._latched,
            taught=bool(self._graph.taught),
            bearing=self.service.config.robot.sensor == "bearing",
        )

    # --- what is asked for -------------------------------------------------------------------------------------------

    def act(self, action: str, arguments: Mapping[str, Any]) -> object:
        """An operator's command."""
        if action == "background":
            told = self._backgrounds.align(self._environment, arguments.get("shown"))
            self.channel.set("background", self._backgrounds.section(self._environment))
            return told
        if action == "merge":
            arguments = {"candidates": self._candidates(arguments)}
        try:
            told = self._actions.do(action, arguments)
        except RetraverseError as error:
            self._tell([Event("command", f"{action.replace('_', ' ')} refused: {error}", bad=True)])
            raise
        self._tell([Event("command", f"{action.replace('_', ' ')}: {told}")])
        self._fetcher.wake()
        return told

    def _candidates(self, arguments: Mapping[str, Any]) -> list[str]:
        """Where a map may be merged: around a vertex that the operator clicks, else around the robot."""
        state, odometry = self._state, self._last_odometry
        taught = None if state is None or state.map is None else state.map.id
        if arguments.get("vertex"):
            near = self._graph.around(vertex_of(arguments["vertex"]), 3)
        elif odometry is None or odometry.vertex is None:
            near = []
        else:
            pose = self._graph.place(odometry.vertex, planar(odometry.T_vertex_robot))
            near = [] if pose is None else self._graph.near(pose, _MERGE_M, taught or "", _MERGE_MOST)
        if not near:
            raise BadArguments("no taught vertex is near the robot: click the vertex that the map should meet")
        return [str(vertex) for vertex in near]

    def resource(self, path: str) -> Resource | None:
        """A background's image or tile."""
        return self._backgrounds.resource(path.removeprefix(_BACKGROUND)) if path.startswith(_BACKGROUND) else None

    def store(self, path: str, body: bytes) -> object:
        """Takes an image for the background."""
        if not path.startswith(_BACKGROUND):
            raise BadArguments("the page takes images for the background alone")
        told = self._backgrounds.store(path.removeprefix(_BACKGROUND), body)
        self.channel.set("background", self._backgrounds.section(self._environment))
        return told

    # --- the joystick ------------------------------------------------------------------------------------------------

    def hear(self, browser: int, message: Mapping[str, Any]) -> None:
        """The joystick, while it is held: ``{"drive": [forwards, left, seconds]}``; ``{"release": true}`` lets go."""
        if "release" in message:
            self._release(browser)
        elif "drive" in message and not self._refused.get("teleop", "unknown"):
            try:
                forwards, left, sent = (float(value) for value in message["drive"])
            except (TypeError, ValueError):
                return
            with self._lock:
                velocity = self._teleop.take(browser, forwards, left, sent, time.monotonic())
                if velocity is not None:
                    self._send(velocity, held=True)

    def left(self, browser: int) -> None:
        """A browser that has gone has let go."""
        self._release(browser)

    def _release(self, browser: int) -> None:
        with self._lock:
            if self._teleop.release(browser):
                self._send(Velocity(0.0, 0.0), held=False)

    def _send(self, velocity: Velocity, *, held: bool) -> None:
        stamp = now_ns()
        axes = [velocity.v / self.settings.speed, velocity.w / self.settings.turn_rate]
        self._joystick_out.put(Joystick(stamp=stamp, axes=axes, held=held))
        self._teleop_out.put(VelocityCommand(stamp=stamp, v=velocity.v, w=velocity.w))


def _backgrounds(service: Service, settings: Settings) -> Backgrounds:
    own = service.config.directory / "console"
    folder = settings.path(settings.backgrounds, service.config.path) if settings.backgrounds else own / "backgrounds"
    return Backgrounds(folder, own / "background.json")
