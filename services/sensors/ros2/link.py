"""What the threads of the driver share: the two sides, and what is known of the robot."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

import structlog

from common.bus import Presence
from common.geometry import Array
from common.service import Service
from services.sensors.calibration.rectify import Rectifier
from services.sensors.recordings.ros.frames import StaticFrames
from services.sensors.ros2.errors import RosDataError
from services.sensors.ros2.graph import Arrived, RosGraph, RosSubscription
from services.sensors.ros2.outputs import RouteTransform
from services.sensors.ros2.settings import Ros2Settings
from services.sensors.settings import Settings

log = structlog.get_logger()

_REPORT_S = 10.0
_LOOK_S = 0.2


class Reporter:
    """Says what goes wrong again and again once in ten seconds."""

    def __init__(self) -> None:
        self._said: dict[str, float] = {}

    def say(self, about: str, reason: str) -> None:
        """Logs a sentence on a subject."""
        now = time.monotonic()
        if now - self._said.get(about, -_REPORT_S) >= _REPORT_S:
            self._said[about] = now
            log.warning("ROS 2", about=about, reason=reason)


@dataclass(frozen=True, slots=True)
class Link:
    """The service, the graph, and what one thread learns for another.

    Attributes:
        calibration: what rectifies in place of camera infos.
        frames: of ``/tf_static``.
        route: where the route's frame is.
    """

    service: Service
    sensors: Settings
    graph: RosGraph
    presence: Presence
    quiet: str
    calibration: Rectifier | None
    frames: StaticFrames
    route: RouteTransform = field(default_factory=RouteTransform)
    reporter: Reporter = field(default_factory=Reporter)

    @property
    def settings(self) -> Ros2Settings:
        """``[sensors.ros2]``."""
        return self.sensors.ros2

    @property
    def silent(self) -> bool:
        """Whether a playback has taken the sensors' place."""
        return self.quiet in self.presence

    def looks(self, wake: threading.Event) -> Iterator[None]:
        """Each time that something has arrived, and some times a second, until the service stops."""
        while not self.service.stop.is_set():
            wake.wait(_LOOK_S)
            wake.clear()
            yield

    def mounting(self, frame: str) -> Array | None:
        """``T_vehicle_frame`` (4, 4) of a sensor; None, as one at the vehicle's origin, where it is not asked for.

        Raises:
            RosDataError: ``/tf_static`` has not told it.
        """
        if self.settings.mounting == "none":
            return None
        T = self.frames.T_vehicle(frame)
        if T is None:
            raise RosDataError(
                f"{self.settings.inputs.static_transforms or '/tf_static'} does not tell where '{frame}' is on "
                f"'{self.settings.frames.base}': publish it, or set mounting = 'none'"
            )
        return T


def each(subscription: RosSubscription, use: Callable[[Arrived], None]) -> None:
    """Uses every unread message; one that is of no use is counted and dropped."""
    while (arrived := subscription.take()) is not None:
        try:
            use(arrived)
        except RosDataError as error:
            subscription.drop(str(error))
