"""Odometry and localization over whole recordings, in one process and without a bus."""

from services.estimator.offline.localization import LocalizationRun, Processed, Route, process, run_localization
from services.estimator.offline.odometry import Drift, OdometryRun, measure_drift, run_lidar_odometry, run_odometry
from services.estimator.offline.recording import LidarRecording, OnFrame, Pair, Recording

__all__ = [
    "Drift",
    "LidarRecording",
    "LocalizationRun",
    "OdometryRun",
    "OnFrame",
    "Pair",
    "Processed",
    "Recording",
    "Route",
    "measure_drift",
    "process",
    "run_lidar_odometry",
    "run_localization",
    "run_odometry",
]
