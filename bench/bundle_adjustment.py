"""What bundle adjustment over the window of keyframes does for odometry: drift and time, without and with it.

On the recordings where they are at hand, and on a drive through the synthetic world, whose truth is exact. Everything
runs on one thread; the adjustment's own thread is the caller's here, so that its time is seen.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from datetime import UTC, datetime
from time import process_time
from typing import Any, NamedTuple

import cv2
import numpy as np

from bench import table
from bench.recordings import kitti
from common.camera import StereoCamera
from common.geometry import Array
from services.estimator.offline.odometry import measure_drift
from services.estimator.stereo import StereoOdometry, StereoSettings, warm_up
from services.estimator.stereo.window import WindowAdjuster, WindowKeyframe
from services.sensors.world import World, WorldSettings
from services.sensors.world.traversal import DrivingSettings, Traversal

_RECORDINGS = ("kitti06_gray_stereo", "kitti02_colour_stereo")


class _Drive(NamedTuple):
    name: str
    camera: StereoCamera
    pairs: list[Any]
    truth: Array


class _Timed(WindowAdjuster):
    """Keeps the processor's milliseconds of every keyframe."""

    def __init__(self, camera: StereoCamera, settings: StereoSettings) -> None:
        super().__init__(camera, settings, synchronous=True)
        self.milliseconds: list[float] = []

    def put(self, keyframe: WindowKeyframe) -> None:
        begin = process_time()
        super().put(keyframe)
        self.milliseconds.append(1e3 * (process_time() - begin))


def _drives() -> Iterable[_Drive]:
    for name in _RECORDINGS:
        recording = kitti(name)
        if recording is not None and recording.poses_truth is not None:
            yield _Drive(name, recording.camera, list(recording), recording.poses_truth)
    world = World(WorldSettings())
    traversal = Traversal.of(world, datetime(2026, 6, 21, 11, tzinfo=UTC), DrivingSettings(spacing=0.15), 0)
    pairs = list(traversal)
    assert traversal.poses_truth is not None
    yield _Drive("synthetic world", world.camera, pairs, traversal.poses_truth)


def _row(drive: _Drive, way: str, settings: StereoSettings, *, adjusted: bool) -> list[object]:
    adjuster = _Timed(drive.camera, settings) if adjusted else None
    odometry = StereoOdometry(drive.camera, settings, adjuster)
    poses, frames = [], []
    for pair in drive.pairs:
        before = sum(adjuster.milliseconds) if adjuster else 0.0
        begin = process_time()
        poses.append(odometry.process(pair.left, pair.right, pair.stamp_ns).T_odom_live)
        adjusting = sum(adjuster.milliseconds) - before if adjuster else 0.0
        frames.append(1e3 * (process_time() - begin) - adjusting)
    drift = measure_drift(np.array(poses), drive.truth)
    each = float(np.median(adjuster.milliseconds)) if adjuster else "-"
    return [drive.name, way, 100 * drift.end_point, 100 * drift.frame_error, float(np.median(frames)), each]


def main() -> None:
    """Print the table."""
    cv2.setNumThreads(1)
    settings = StereoSettings()
    landmarks = replace(settings, bundle=replace(settings.bundle, refine_landmarks=True))
    rows = []
    for drive in _drives():
        warm_up(drive.camera, settings)
        _row(drive._replace(pairs=drive.pairs[:12], truth=drive.truth[:12]), "", settings, adjusted=True)
        rows.append(_row(drive, "odometry alone", settings, adjusted=False))
        rows.append(_row(drive, "window: poses", settings, adjusted=True))
        rows.append(_row(drive, "window: poses and landmarks", landmarks, adjusted=True))
    table.show(
        "bundle adjustment over a window of keyframes",
        ["drive", "way", "drift at the end, %", "between frames, cm", "ms a frame", "ms an adjustment"],
        rows,
        note="the adjustment runs in a thread of its own in the robot's estimator, and adds nothing to a frame",
    )


if __name__ == "__main__":
    main()
