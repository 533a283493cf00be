"""The obstacle watch on the bus: scans or stereo pairs in, what lies in the way out."""

from __future__ import annotations

import time

import structlog

from common import topics
from common.bus import Subscription
from common.geometry import Array
from common.messages import LidarScan, Obstacles, StereoFrame, Zone
from common.service import Service
from services.obstacles.points import StereoPoints, of_scan
from services.obstacles.settings import Settings
from services.obstacles.zones import Watch, look

_WAIT_S = 0.1

log = structlog.get_logger()


def main(service: Service) -> None:
    """Watches until the service is stopped."""
    ObstacleWatch(service).run()


class ObstacleWatch:
    """The newest frame, looked at again and again. It says what it sees; what follows from that is safety's."""

    def __init__(self, service: Service) -> None:
        self._service = service
        self._settings = service.config.settings("obstacles", Settings)
        bus, settings = service.bus, self._settings
        self._scans: Subscription[LidarScan] | None = None
        self._pairs: Subscription[StereoFrame] | None = None
        if settings.lidar is not None:
            self._scans = bus.subscribe(topics.LIDAR, settings.lidar)
        else:
            self._pairs = bus.subscribe(topics.STEREO, settings.camera)
        self._found = bus.publisher(topics.OBSTACLES)
        self._ahead, self._behind = Watch(settings.zones), Watch(settings.zones)
        self._stereo: StereoPoints | None = None
        self._camera: bytes = b""

    def run(self) -> None:
        """One look after another, never more often than the period."""
        self._service.ready()
        due = 0.0
        while not self._service.stop.is_set():
            if self._service.stop.wait(max(due - time.monotonic(), 0.0)):
                return
            received = self._frames().wait(_WAIT_S)
            if received is None:
                continue
            due = time.monotonic() + self._settings.period_s
            try:
                with self._service.stage("look"):
                    self._take(received.message)
            except (ValueError, ArithmeticError) as error:
                log.warning("a frame cannot be looked at", reason=str(error))

    def _frames(self) -> Subscription[LidarScan] | Subscription[StereoFrame]:
        if self._scans is not None:
            return self._scans
        assert self._pairs is not None  # noqa: S101, one of the two is subscribed to
        return self._pairs

    def _take(self, frame: LidarScan | StereoFrame) -> None:
        points, zones, now = self._points(frame), self._settings.zones, time.monotonic()
        if self._seen(frame) < self._settings.sees:
            # A blind watch must not say that the way is free: safety stops for want of its word.
            return
        ahead = points[:, 0] >= 0.0
        found, behind = look(points[ahead], zones), look(points[~ahead], zones)
        nearest = [one.nearest for one in (found, behind) if one.nearest is not None]
        self._found.put(
            Obstacles(
                stamp=frame.stamp,
                ahead=Zone(self._ahead.see(now, found).name.lower()),
                behind=Zone(self._behind.see(now, behind).name.lower()),
                nearest=min(nearest, default=None),
            )
        )

    def _seen(self, frame: LidarScan | StereoFrame) -> float:
        """The part of a frame in which anything was measured."""
        if isinstance(frame, LidarScan):
            return float((frame.ranges > 0.0).mean())
        return 0.0 if self._stereo is None else self._stereo.seen

    def _points(self, frame: LidarScan | StereoFrame) -> Array:
        if isinstance(frame, LidarScan):
            return of_scan(frame.ranges, frame.elevations, frame.azimuths, frame.T_vehicle_lidar)
        calibration = frame.camera.model_dump_json().encode()
        if self._stereo is None or calibration != self._camera:
            self._stereo = StereoPoints(frame.camera.camera(), self._settings.width, self._settings.nearest)
            self._camera = calibration
        return self._stereo.of_pair(frame.left, frame.right)
