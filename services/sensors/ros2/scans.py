"""The lidar's side: clouds of points as ``sensor/lidar/<name>``."""

from __future__ import annotations

import threading
import time
from typing import Any

from pydantic import ValidationError

from common import topics
from common.geometry import Array
from common.messages import LidarScan, now_ns
from services.sensors.recordings.images import RecordingError
from services.sensors.recordings.organise import scan_message
from services.sensors.recordings.ros.clouds import decode_cloud
from services.sensors.ros2 import types
from services.sensors.ros2.errors import RosDataError
from services.sensors.ros2.graph import Arrived
from services.sensors.ros2.link import Link, each
from services.sensors.ros2.pace import Pace
from services.sensors.ros2.qos import SENSOR_DATA


def scan(message: Any, T_vehicle_lidar: Array | None, now: int, topic: str) -> LidarScan:  # noqa: ANN401, a class made at run time
    """The scan of a ``PointCloud2``; ``now``, nanoseconds, where it has no stamp.

    Raises:
        RosDataError: it is not whole, or of no spinning lidar.
    """
    stamp = types.stamp_of(message.header) or now
    try:
        return scan_message(decode_cloud(message, stamp, topic), T_vehicle_lidar)
    except (RecordingError, ValidationError, ValueError, TypeError, OverflowError, MemoryError) as error:
        # A cloud's fields are its sender's own description of its bytes, which numpy refuses in many ways.
        raise RosDataError(" ".join(str(error).split())[:200]) from None


class Lidar:
    """Publishes scans, in a thread of its own."""

    def __init__(self, link: Link) -> None:
        self._link = link
        self._wake = threading.Event()
        self._points = link.graph.subscribe(link.settings.inputs.points, types.POINTS, SENSOR_DATA, self._wake)
        self._pace = Pace(link.sensors.frame_rate)
        self._scans = link.service.bus.publisher(topics.LIDAR, link.sensors.lidar)
        self.steady = [self._points]

    def run(self) -> None:
        """Publishes scans until the service stops."""
        for _ in self._link.looks(self._wake):
            each(self._points, self._publish)

    def _publish(self, arrived: Arrived) -> None:
        if self._link.silent or not self._pace.lets(time.monotonic()):
            return
        mounting = self._link.mounting(arrived.message.header.frame_id)
        with self._link.service.stage("organise"):
            made = scan(arrived.message, mounting, now_ns(), self._points.topic)
        self._scans.put(made)
