"""The estimator's settings for a run without a robot: a configuration's, or the defaults."""

from __future__ import annotations

from pathlib import Path

from cli import robot
from services.estimator.lidar import LidarSettings
from services.estimator.settings import Settings
from services.estimator.stereo import StereoSettings


def estimator_settings(config: Path | None) -> Settings:
    """``[estimator]`` of the configuration that is named, else the defaults.

    Raises:
        ConfigurationError: the configuration is wrong.
    """
    return Settings() if config is None else robot.load(config).settings("estimator", Settings)


def stereo_settings(config: Path | None) -> StereoSettings:
    """The stereo pipeline's part of :func:`estimator_settings`."""
    return estimator_settings(config).stereo


def lidar_settings(config: Path | None) -> LidarSettings:
    """The lidar pipeline's part of :func:`estimator_settings`."""
    return estimator_settings(config).lidar
