"""The pipeline's settings for a run without a robot: a configuration's, or the defaults."""

from __future__ import annotations

from pathlib import Path

from cli import robot
from services.estimator.settings import Settings
from services.estimator.stereo import StereoSettings


def stereo_settings(config: Path | None) -> StereoSettings:
    """``[estimator]``'s stereo pipeline of the configuration that is named, else its defaults.

    Raises:
        ConfigurationError: the configuration is wrong.
    """
    if config is None:
        return StereoSettings()
    return robot.load(config).settings("estimator", Settings).stereo
