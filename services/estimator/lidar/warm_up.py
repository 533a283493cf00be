"""Compilation of every loop before the first scan: at start it delays nobody, on a scan it does."""

from __future__ import annotations

import numpy as np

from common.geometry import Uncertain
from common.lidar import LidarScan, organised_scan
from services.estimator.lidar.localization import LidarLocalizer
from services.estimator.lidar.odometry import LidarOdometry
from services.estimator.lidar.settings import LidarSettings

_BEAMS, _COLUMNS = 32, 512


def warm_up(settings: LidarSettings | None = None) -> None:
    """Run the whole pipeline on scans of a round, speckled room, so that everything is compiled or read from disk."""
    used = settings or LidarSettings()
    scan = _room()
    unorganised = LidarScan(0, scan.points.reshape(-1, 3), scan.intensity.ravel())
    LidarOdometry(used).process(unorganised)
    odometry = LidarOdometry(used)
    odometry.process(scan)
    result = odometry.process(LidarScan(100_000_000, scan.points, scan.intensity, offsets=scan.offsets))
    landmarks = result.frame.features.landmarks()
    localizer = LidarLocalizer(used)
    localizer.localize(landmarks, result.frame, Uncertain(np.eye(4), 1e-4 * np.eye(6)))
    localizer.localize_without_prior(landmarks, result.frame)


def _room() -> LidarScan:
    rng = np.random.default_rng(1)
    speckles = rng.integers(20, 200, (_BEAMS // 2, _COLUMNS // 4)).repeat(2, axis=0).repeat(4, axis=1)
    elevations, azimuths = np.linspace(0.3, -0.3, _BEAMS), np.linspace(np.pi, -np.pi, _COLUMNS, endpoint=False)
    ranges = np.broadcast_to(6.0 / np.cos(elevations)[:, None], (_BEAMS, _COLUMNS))
    return organised_scan(0, ranges, speckles, elevations, azimuths, np.linspace(-0.1, 0.0, _COLUMNS))
