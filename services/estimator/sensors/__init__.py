"""The kinds of sensors that the estimator drives by: each takes its topic's frames to a pipeline."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from services.estimator.sensors.bearing import BearingSensor
from services.estimator.sensors.lidar import LidarSensor
from services.estimator.sensors.sensor import Sensor
from services.estimator.sensors.stereo import StereoSensor
from services.estimator.settings import Settings

__all__ = ["Sensor", "sensor_of"]


def sensor_of(kind: str, settings: Settings) -> Sensor[Any, Any, Any]:
    """The sensor of the name that ``[robot]`` has for it.

    Raises:
        ConfigurationError: it cannot be used as configured.
    """
    sensors: dict[str, Callable[[Settings], Sensor[Any, Any, Any]]] = {
        "stereo": StereoSensor,
        "lidar": LidarSensor,
        "bearing": BearingSensor,
    }
    return sensors[kind](settings)
