"""One uncalibrated camera, and the wheels, as the estimator's sensor."""

from __future__ import annotations

import numpy as np
import structlog

from common import topics
from common.geometry import Array
from common.messages import CameraFrame
from services.estimator.bearing import BearingPipeline, BearingRouteLocalizer
from services.estimator.bearing.comparison import BearingLive, Comparison
from services.estimator.bearing.submap import BearingSubmap
from services.estimator.pipeline import Pipeline
from services.estimator.relocalization.appearance import Appearance
from services.estimator.route_map import RouteMap
from services.estimator.settings import Settings

log = structlog.get_logger()

_ANY_IMAGE = (48, 64)


class BearingSensor:
    """See :class:`services.estimator.sensors.sensor.Sensor`."""

    topic = topics.CAMERA
    pictures: tuple[str, ...] = ("image",)

    def __init__(self, settings: Settings) -> None:
        """Raises ConfigurationError where the configured network cannot be used."""
        self.name = settings.camera
        self._settings = settings
        self._comparison = Comparison(settings.bearing)

    def warm_up(self) -> None:
        """Compiles the representation's loop."""
        self._comparison.prepare(np.zeros(_ANY_IMAGE, np.uint8))

    def calibration(self, frame: CameraFrame) -> None:
        """Nothing: the camera has none, and images may change their size."""
        del frame

    def open(self, frame: CameraFrame) -> BearingPipeline:
        """A pipeline, which has no threads."""
        height, width = frame.image.shape[:2]
        log.info("a camera appeared", width=width, height=height, images=self._comparison.name)
        return BearingPipeline(self._settings.bearing, self._comparison)

    def searcher(self, frame: CameraFrame) -> BearingPipeline:
        """Another one, with actions of its own."""
        del frame
        return BearingPipeline(self._settings.bearing, self._comparison)

    def localizer(
        self,
        route_map: RouteMap[BearingLive, BearingSubmap],
        path: Array,
        pipeline: Pipeline[BearingLive, BearingSubmap],
    ) -> BearingRouteLocalizer:
        """By a particle filter along the route."""
        s = self._settings
        return BearingRouteLocalizer(route_map, path, pipeline, s.chain, s.window, s.bearing, self._comparison)

    def appearance(self, live: BearingLive) -> Appearance:
        """Nothing: a bearing map is recognised around a given start alone."""
        del live
        return {}
