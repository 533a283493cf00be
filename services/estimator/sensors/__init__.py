"""The kinds of sensors that the estimator drives by: each takes its topic's frames to a pipeline."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from common.errors import ConfigurationError
from services.estimator.sensors.bearing import BearingSensor
from services.estimator.sensors.sensor import Sensor
from services.estimator.sensors.stereo import StereoSensor
from services.estimator.settings import Settings

__all__ = ["Sensor", "sensor_of"]


def sensor_of(settings: Settings) -> Sensor[Any, Any, Any]:
    """The sensor that the settings name.

    Raises:
        ConfigurationError: there is none of that kind, or it cannot be used as configured.
    """
    kinds: dict[str, Callable[[Settings], Sensor[Any, Any, Any]]] = {"stereo": StereoSensor, "bearing": BearingSensor}
    if settings.sensor not in kinds:
        raise ConfigurationError(f"this version has no estimator for the sensor '{settings.sensor}'")
    return kinds[settings.sensor](settings)
