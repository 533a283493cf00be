"""The kinds of sensors that the estimator drives by: each takes its topic's frames to a pipeline."""

from __future__ import annotations

from typing import Any

from services.estimator.sensors.sensor import Sensor
from services.estimator.sensors.stereo import StereoSensor
from services.estimator.settings import Settings

__all__ = ["Sensor", "sensor_of"]


def sensor_of(settings: Settings) -> Sensor[Any, Any, Any]:
    """The sensor that the settings name."""
    return StereoSensor(settings)
