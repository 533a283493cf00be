"""A stereo camera as the estimator's sensor."""

from __future__ import annotations

from collections.abc import Hashable

import numpy as np
import structlog

from common import topics
from common.camera import StereoCamera
from common.geometry import Array, Uncertain
from common.messages import CameraModel, StereoFrame
from services.estimator.pipeline import Pipeline, Step
from services.estimator.relocalization.appearance import Appearance, appearance_of
from services.estimator.route_localizer import RouteLocalizer
from services.estimator.route_map import RouteMap
from services.estimator.settings import Settings
from services.estimator.stereo.pipeline import StereoPipeline
from services.estimator.stereo.streams import Streams
from services.estimator.stereo.submap import StereoSubmap
from services.estimator.stereo.warm_up import warm_up

log = structlog.get_logger()

_ANY_CAMERA = StereoCamera(640, 400, 425.0, 425.0, 319.5, 199.5, 0.24)
"""What is compiled before the first frame serves every camera."""


class StereoFrames(StereoPipeline):
    """The stereo pipeline, fed with messages."""

    def take(self, frame: StereoFrame, prior: Uncertain | None) -> Step[Streams]:
        """Preprocessing and odometry of a pair."""
        return self.process(frame.left, frame.right, frame.stamp, prior)


class StereoSensor:
    """See :class:`services.estimator.sensors.sensor.Sensor`."""

    topic = topics.STEREO
    pictures: tuple[str, ...] = ("left", "right")

    def __init__(self, settings: Settings) -> None:
        self.name = settings.camera
        self._settings = settings

    def warm_up(self) -> None:
        """Compiles the pipeline's loops."""
        warm_up(_ANY_CAMERA, self._settings.stereo)

    def calibration(self, frame: StereoFrame) -> tuple[Hashable, ...]:
        """All that is known of the camera; arrays by their bytes, as they have no single equality."""
        values = (getattr(frame.camera, name) for name in CameraModel.model_fields)
        return tuple(value.tobytes() if isinstance(value, np.ndarray) else value for value in values)

    def open(self, frame: StereoFrame) -> StereoFrames:
        """A pipeline with the invariant stream in a thread of its own."""
        camera = frame.camera
        pipeline = StereoFrames(camera.camera(), self._settings.stereo, parallel=True)
        log.info(
            "a camera appeared",
            width=camera.width,
            height=camera.height,
            baseline=round(camera.baseline, 4),
            streams=pipeline.streams_of(frame.left),
        )
        return pipeline

    def searcher(self, frame: StereoFrame) -> StereoPipeline:
        """A pipeline without threads."""
        return StereoPipeline(frame.camera.camera(), self._settings.stereo)

    def localizer(
        self, route_map: RouteMap[Streams, StereoSubmap], path: Array, pipeline: Pipeline[Streams, StereoSubmap]
    ) -> RouteLocalizer[Streams, StereoSubmap]:
        """Along the localization chain."""
        return RouteLocalizer(route_map, path, pipeline, self._settings.chain, self._settings.window)

    def appearance(self, live: Streams) -> Appearance:
        """Descriptors of the nearest features in every stream."""
        features = {name: frame.features for name, frame in live.items()}
        return appearance_of(features, self._settings.relocalization.query_descriptors)
