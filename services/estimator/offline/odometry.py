"""Odometry over a whole recording of any sensor, in one process and without a bus."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from time import perf_counter
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from common import geometry
from common.errors import RetraverseError
from common.lidar import LidarScan
from services.estimator.lidar import LidarOdometry, LidarSettings, ScanError
from services.estimator.lidar import warm_up as warm_up_lidar
from services.estimator.lidar.preprocessing import LidarFrame
from services.estimator.odometry_result import OdometryResult
from services.estimator.offline.recording import LidarRecording, OnFrame, Recording
from services.estimator.stereo import StereoOdometry, StereoSettings, warm_up
from services.estimator.stereo.window import WindowAdjuster

Array = NDArray[np.float64]
Frame = TypeVar("Frame")


@dataclass(frozen=True, slots=True)
class OdometryRun:
    """Odometry over a recording of N frames.

    Attributes:
        poses: (N, 4, 4) ``T_first_live``: the left camera, or the lidar, in the frame of the first one.
        success: (N,) bool, whether each motion was measured.
        reasons: N sentences, empty where it was.
        inliers: (N,) landmarks that agreed.
        milliseconds: (N,) spent on each frame, without reading it.
        reading_milliseconds: (N,) spent on reading and decoding each frame.
        stages: milliseconds (N,) by stage.
    """

    poses: Array
    success: NDArray[np.bool_]
    reasons: tuple[str, ...]
    inliers: NDArray[np.int64]
    milliseconds: Array
    reading_milliseconds: Array
    stages: dict[str, Array]


@dataclass(frozen=True, slots=True)
class Drift:
    """How far a path ends from the truth when both begin alike.

    Attributes:
        end_point: distance between the two ends, as a part of the true path's length.
        rotation: angle between the two ends, radians.
        length: of the true path, metres.
        frame_error: median distance between estimated and true motion from pair to pair, metres.
    """

    end_point: float
    rotation: float
    length: float
    frame_error: float


def measure_drift(poses: Array, truth: Array) -> Drift:
    """Compare poses (N, 4, 4) with the truth (N, 4, 4), aligned at the first; N is at least 2."""
    estimated, true = geometry.inverse(poses[0]) @ poses, geometry.inverse(truth[0]) @ truth
    length = float(np.linalg.norm(np.diff(true[:, :3, 3], axis=0), axis=1).sum())
    end = float(np.linalg.norm(estimated[-1, :3, 3] - true[-1, :3, 3]))
    rotation = float(geometry.rotation_angle(geometry.inverse(true[-1]) @ estimated[-1]))
    motions = (geometry.inverse(poses[:-1]) @ poses[1:] for poses in (true, estimated))
    error = geometry.inverse(next(motions)) @ next(motions)
    return Drift(
        end_point=end / length if length > 0.0 else np.inf,
        rotation=rotation,
        length=length,
        frame_error=float(np.median(np.linalg.norm(error[:, :3, 3], axis=1))),
    )


def run_odometry(
    recording: Recording, settings: StereoSettings | None = None, on_frame: OnFrame | None = None
) -> OdometryRun:
    """Odometry over a recording; ``on_frame`` is called after every pair, to show progress.

    What the recording raises when a pair cannot be read is passed on.
    """
    warm_up(recording.camera, settings)
    s = settings or StereoSettings()
    adjuster = WindowAdjuster(recording.camera, s, synchronous=True) if s.bundle.enabled else None
    odometry = StereoOdometry(recording.camera, s, adjuster)
    return collect(recording, lambda _, pair: odometry.process(pair.left, pair.right, pair.stamp_ns), on_frame)


def run_lidar_odometry(
    recording: LidarRecording, settings: LidarSettings | None = None, on_frame: OnFrame | None = None
) -> OdometryRun:
    """Odometry over a recording of a lidar; ``on_frame`` is called after every scan, to show progress.

    Raises:
        RetraverseError: a scan is not sound; the sentence says which and why.
    """
    warm_up_lidar(settings)
    odometry = LidarOdometry(settings)

    def step(index: int, scan: LidarScan) -> OdometryResult[LidarFrame]:
        try:
            return odometry.process(scan)
        except ScanError as error:
            raise RetraverseError(f"scan {index} of {recording.name} cannot be used: {error}") from error

    return collect(recording, step, on_frame)


def collect(
    frames: Iterable[Frame], process: Callable[[int, Frame], OdometryResult[Any]], on_frame: OnFrame | None
) -> OdometryRun:
    """What ``process`` makes of the frames, of which each is let go: a long recording does not fit in memory."""
    kept: list[tuple[Array, bool, str, int, dict[str, float]]] = []
    spent: list[tuple[float, float]] = []
    begin = perf_counter()
    for index, frame in enumerate(frames):
        read = perf_counter()
        result = process(index, frame)
        end = perf_counter()
        kept.append((result.T_odom_live, result.success, result.reason, result.inliers, result.milliseconds))
        spent.append((1e3 * (read - begin), 1e3 * (end - read)))
        if on_frame is not None:
            on_frame()
        begin = perf_counter()
    poses, success, reasons, inliers, stages = zip(*kept, strict=True) if kept else ((),) * 5
    times = np.array(spent, dtype=np.float64).reshape(-1, 2)
    return OdometryRun(
        poses=np.array(poses).reshape(-1, 4, 4),
        success=np.array(success, dtype=np.bool_),
        reasons=tuple(reasons),
        inliers=np.array(inliers, dtype=np.int64),
        milliseconds=times[:, 1],
        reading_milliseconds=times[:, 0],
        stages={name: np.array([s[name] for s in stages]) for name in (stages[0] if stages else {})},
    )
