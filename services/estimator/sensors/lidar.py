"""A spinning lidar as the estimator's sensor."""

from __future__ import annotations

import structlog

from common import topics
from common.geometry import Array, Uncertain
from common.lidar import organised_scan
from common.messages import LidarScan
from services.estimator.lidar.appearance import appearance_of
from services.estimator.lidar.mapping import LidarSubmap
from services.estimator.lidar.pipeline import LidarPipeline
from services.estimator.lidar.preprocessing import LidarFrame
from services.estimator.lidar.warm_up import warm_up
from services.estimator.pipeline import Pipeline, Step
from services.estimator.relocalization.appearance import Appearance
from services.estimator.route_localizer import RouteLocalizer
from services.estimator.route_map import RouteMap
from services.estimator.settings import Settings

log = structlog.get_logger()


class LidarScans(LidarPipeline):
    """The lidar pipeline, fed with messages."""

    def take(self, frame: LidarScan, prior: Uncertain | None) -> Step[LidarFrame]:
        """Preprocessing and odometry of a scan."""
        directions = frame.elevations, frame.azimuths
        return self.process(
            organised_scan(frame.stamp, frame.ranges, frame.intensities, *directions, frame.offsets), prior
        )


class LidarSensor:
    """See :class:`services.estimator.sensors.sensor.Sensor`."""

    topic = topics.LIDAR
    pictures: tuple[str, ...] = ("ranges",)

    def __init__(self, settings: Settings) -> None:
        self.name = settings.scanner
        self._settings = settings

    def warm_up(self) -> None:
        """Compiles the pipeline's loops."""
        warm_up(self._settings.lidar)

    def calibration(self, frame: LidarScan) -> tuple[int, int, bytes]:
        """The scan's size, and where the lidar sits on its vehicle."""
        return (*frame.ranges.shape, frame.T_vehicle_lidar.tobytes())

    def open(self, frame: LidarScan) -> LidarScans:
        """A pipeline of its own."""
        beams, columns = frame.ranges.shape
        log.info("a lidar appeared", beams=beams, columns=columns)
        return LidarScans(frame.T_vehicle_lidar, self._settings.lidar)

    def searcher(self, frame: LidarScan) -> LidarPipeline:
        """Another one."""
        return LidarPipeline(frame.T_vehicle_lidar, self._settings.lidar)

    def localizer(
        self, route_map: RouteMap[LidarFrame, LidarSubmap], path: Array, pipeline: Pipeline[LidarFrame, LidarSubmap]
    ) -> RouteLocalizer[LidarFrame, LidarSubmap]:
        """Along the localization chain."""
        return RouteLocalizer(route_map, path, pipeline, self._settings.chain, self._settings.window)

    def appearance(self, live: LidarFrame) -> Appearance:
        """Descriptors of the surest landmarks."""
        return appearance_of(live.features.landmarks(), self._settings.relocalization.query_descriptors)
