"""What the graph is told of the robot's way: the route, where the robot is on it, and the odometry by its eyes."""

from __future__ import annotations

import threading

from common import topics
from common.messages import Localization, now_ns
from services.sensors.ros2 import outputs, types
from services.sensors.ros2.link import Link
from services.sensors.ros2.outputs import VisualOdometry
from services.sensors.ros2.qos import DEFAULT, LATCHED, TRANSFORMS


class Telling:
    """Publishes them, in a thread of its own."""

    def __init__(self, link: Link) -> None:
        self._link = link
        self._wake = threading.Event()
        bus, graph, names = link.service.bus, link.graph, link.settings.outputs
        self._routes = bus.subscribe(topics.ROUTE, wake=self._wake)
        self._localizations = bus.subscribe(topics.LOCALIZATION, wake=self._wake)
        self._odometries = bus.subscribe(topics.ODOMETRY, wake=self._wake)
        frames = link.settings.frames
        self._visual = VisualOdometry(frames.visual, frames.base)
        self._path = graph.publisher(names.route, types.PATH, LATCHED) if names.route else None
        self._odometry = graph.publisher(names.odometry, types.ODOMETRY, DEFAULT) if names.odometry else None
        self._transforms = graph.publisher(names.transforms, types.TRANSFORMS, TRANSFORMS) if names.transforms else None

    def run(self) -> None:
        """Carries them over until the service stops."""
        for _ in self._link.looks(self._wake):
            while (route := self._routes.poll()) is not None:
                self._link.route.follow(route.message)
                if self._path is not None:
                    self._path.put(outputs.path(route.message, self._link.settings.frames.route, now_ns()))
            while (odometry := self._odometries.poll()) is not None:
                if self._odometry is not None:
                    self._odometry.put(self._visual.message(odometry.message))
            while (localization := self._localizations.poll()) is not None:
                self._place(localization.message)

    def _place(self, localization: Localization) -> None:
        """Puts the route's frame above that of the robot's odometry, or above the robot where it has none."""
        if self._transforms is None:
            return
        frames, route = self._link.settings.frames, self._link.route
        child = frames.odometry or frames.base
        T = route.T_route_odom(localization) if frames.odometry else route.T_route_base(localization)
        if T is not None:
            self._transforms.put(outputs.transform(T, localization.stamp, frames.route, child))
