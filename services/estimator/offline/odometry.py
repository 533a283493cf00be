"""Odometry over a whole recording, in one process and without a bus."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from time import perf_counter

import numpy as np
from numpy.typing import NDArray

from common import geometry
from services.estimator.offline.recording import OnFrame, Recording
from services.estimator.stereo import OdometryResult, StereoOdometry, StereoSettings, warm_up
from services.estimator.stereo.window import WindowAdjuster

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class OdometryRun:
    """Odometry over a recording of N pairs.

    Attributes:
        poses: (N, 4, 4) ``T_first_left``: the left camera in the frame of the first pair.
        success: (N,) bool, whether each motion was measured.
        reasons: N sentences, empty where it was.
        inliers: (N,) landmarks that agreed.
        milliseconds: (N,) spent on each pair, without reading it.
        reading_milliseconds: (N,) spent on reading and decoding each pair.
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
        length: of the true path, metres.
        frame_error: median distance between estimated and true motion from pair to pair, metres.
    """

    end_point: float
    length: float
    frame_error: float


def measure_drift(poses: Array, truth: Array) -> Drift:
    """Compare poses (N, 4, 4) with the truth (N, 4, 4), aligned at the first; N is at least 2."""
    estimated, true = geometry.inverse(poses[0]) @ poses, geometry.inverse(truth[0]) @ truth
    length = float(np.linalg.norm(np.diff(true[:, :3, 3], axis=0), axis=1).sum())
    end = float(np.linalg.norm(estimated[-1, :3, 3] - true[-1, :3, 3]))
    motions = (geometry.inverse(poses[:-1]) @ poses[1:] for poses in (true, estimated))
    error = geometry.inverse(next(motions)) @ next(motions)
    return Drift(
        end / length if length > 0.0 else np.inf, length, float(np.median(np.linalg.norm(error[:, :3, 3], axis=1)))
    )


def run_odometry(
    recording: Recording, settings: StereoSettings | None = None, on_frame: OnFrame | None = None
) -> OdometryRun:
    """Odometry over a recording; ``on_frame`` is called after every pair, to show progress.

    What the recording raises when a pair cannot be read is passed on.
    """
    warm_up(recording.camera, settings)
    results: list[tuple[Array, bool, str, int, dict[str, float]]] = []
    spent: list[tuple[float, float]] = []
    for result, reading, processing in _odometry(recording, settings):
        # The frame itself is let go: a long recording's images do not fit in memory.
        results.append((result.T_odom_live, result.success, result.reason, result.inliers, result.milliseconds))
        spent.append((reading, processing))
        if on_frame is not None:
            on_frame()
    poses, success, reasons, inliers, stages = zip(*results, strict=True) if results else ((),) * 5
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


def _odometry(recording: Recording, settings: StereoSettings | None) -> Iterator[tuple[OdometryResult, float, float]]:
    """Results with the milliseconds of reading and of processing each pair."""
    s = settings or StereoSettings()
    adjuster = WindowAdjuster(recording.camera, s, synchronous=True) if s.bundle.enabled else None
    odometry = StereoOdometry(recording.camera, s, adjuster)
    begin = perf_counter()
    for pair in recording:
        read = perf_counter()
        result = odometry.process(pair.left, pair.right, pair.stamp_ns)
        end = perf_counter()
        yield result, 1e3 * (read - begin), 1e3 * (end - read)
        begin = perf_counter()
