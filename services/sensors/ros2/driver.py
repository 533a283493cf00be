"""The driver ``ros2``: joins a ROS graph, and lets a thread for each side carry its topics to the bus and back."""

from __future__ import annotations

import time

import structlog
import zenoh

from common.errors import ConfigurationError
from common.service import Service
from services.sensors.cameras import load_rectifier
from services.sensors.recordings.ros.frames import StaticFrames
from services.sensors.ros2.graph import RosGraph, RosPublisher, RosSubscription
from services.sensors.ros2.graph_cache import GraphCache
from services.sensors.ros2.link import Link, Reporter
from services.sensors.ros2.motion import Commands, Motion
from services.sensors.ros2.scans import Lidar
from services.sensors.ros2.telling import Telling
from services.sensors.ros2.vision import OneCamera, Stereo
from services.sensors.settings import Settings

log = structlog.get_logger()

_RETRY_S = 0.5
_LOOK_S = 1.0
_SILENT_S = 5.0
_LAST_S = 0.3


class Ros2Driver:
    """A ROS 2 robot as this robot's sensors and base."""

    def __init__(self, service: Service, settings: Settings, quiet: str) -> None:
        """Nothing of the sensors' topics is published while the process ``quiet`` is there.

        Raises:
            ConfigurationError: the graph's router is the robot's own, which cannot be both, or the calibration that is
                named cannot be used.
        """
        if settings.ros2.endpoint == service.config.bus.endpoint:
            raise ConfigurationError(
                f"{service.config.path}: {settings.ros2.endpoint} is the robot's own router, which [bus] names, and "
                "not that of the ROS graph: give one of them another port"
            )
        self._calibration = None if settings.calibration is None else load_rectifier(service, settings)
        self._service = service
        self._settings = settings
        self._quiet = quiet
        self._presence = service.bus.presence()
        self._reporter = Reporter()
        self._heard = time.monotonic()
        self._nodes = GraphCache(settings.ros2.node)

    def run(self) -> None:
        """Carries topics over until the service stops."""
        self._service.thread(self._live, "ros2")
        self._service.ready()
        self._service.stop.wait()

    def _live(self) -> None:
        graph = self._joined()
        if graph is None:
            return
        with graph:
            link = self._link(graph)
            graph.watch(self._nodes.told)
            commands = Commands(link)
            commanding = self._service.thread(commands.run, "commands")
            steady = self._start(link)
            log.info("joined the ROS graph", endpoint=self._settings.ros2.endpoint, domain=self._settings.ros2.domain)
            while not self._service.stop.wait(_LOOK_S):
                self._look_after(graph, steady, commands.commands)
            # The last command stops the base, and must leave before the session ends.
            commanding.join(_LAST_S)

    def _joined(self) -> RosGraph | None:
        """The graph, once its router is there; None where the service stops before."""
        while not self._service.stop.is_set():
            try:
                return RosGraph(self._settings.ros2, self._service.bus.statistics)
            except zenoh.ZError:
                self._reporter.say("router", f"no Zenoh router answers at {self._settings.ros2.endpoint}: is it up?")
                self._service.stop.wait(_RETRY_S)
        return None

    def _link(self, graph: RosGraph) -> Link:
        frames = StaticFrames(vehicles=(self._settings.ros2.frames.base,))
        return Link(
            self._service, self._settings, graph, self._presence, self._quiet, self._calibration, frames,
            reporter=self._reporter,
        )  # fmt: skip

    def _start(self, link: Link) -> list[RosSubscription]:
        """Starts the threads; returns what should be heard all the time."""
        wanted, service = link.settings.inputs, self._service
        motion = Motion(link)
        service.thread(motion.run, "motion")
        service.thread(Telling(link).run, "telling")
        steady = list(motion.steady)
        for asked, side in ((wanted.left, Stereo), (wanted.image, OneCamera), (wanted.points, Lidar)):
            if asked:
                sensing = side(link)
                steady += sensing.steady
                service.thread(sensing.run, side.__name__.lower())
        return steady

    def _look_after(self, graph: RosGraph, steady: list[RosSubscription], commands: RosPublisher) -> None:
        """Says what is missing."""
        if not graph.connected():
            self._reporter.say("router", f"the router at {self._settings.ros2.endpoint} has gone")
            return
        now = time.monotonic()
        for subscription in steady:
            if now - subscription.heard > _SILENT_S:
                # Only rmw_zenoh tells who is there.
                why = self._nodes.why_silent(subscription.endpoint) if graph.attaches else "does the bridge carry it?"
                self._reporter.say(subscription.topic, f"nothing comes: {why}")
        unheard = self._nodes.why_unheard(commands.endpoint) if graph.attaches else None
        if unheard is None:
            self._heard = now
        elif now - self._heard > _SILENT_S:
            self._reporter.say(commands.topic, f"no base obeys: {unheard}")
