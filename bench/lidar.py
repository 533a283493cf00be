"""Lidar odometry beside its peers, on the same scans in one run: drift, rotation and time.

* KISS-ICP (PyPI ``kiss-icp``), with its own defaults for a HDL-64: registration of all points against a voxel map;
* the naive way: SIFT on the intensity image, brute force from scan to scan, RANSAC of three points.

The pseudo truth of these drives *is* KISS-ICP's, so its own error says how closely it repeats itself, not how good it
is. Times of one thread are of the processor, so that other work counts little; "as run" is by the clock, with as many
threads as each takes. Run: ``python -m bench lidar``.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np
from kiss_icp.config import KISSConfig
from kiss_icp.kiss_icp import KissICP
from numpy.typing import NDArray

from bench import recordings, table
from common import geometry
from common.lidar import LidarScan
from services.estimator.lidar import LidarOdometry, LidarSettings, warm_up
from services.estimator.lidar.ransac import rigid
from services.estimator.offline import measure_drift
from services.sensors.recordings import LidarRecording, open_lidar_recording

Array = NDArray[np.float64]
Step = Callable[[LidarScan], Array]
"""Takes the next scan; the pose of the lidar in the frame of the first."""

DRIVES = ("lidar_kitti_city", "lidar_kitti_street22")
_ROWS, _COLUMNS = 64, 1800


def ours() -> Step:
    """The pipeline of this project."""
    odometry = LidarOdometry(LidarSettings())
    return lambda scan: odometry.process(scan).T_odom_live


def kiss_icp(threads: int) -> Step:
    """KISS-ICP on ``threads`` threads, 0 for all; KITTI's scans are corrected for the motion already."""
    config = KISSConfig()
    config.data.deskew = False
    config.mapping.voxel_size = config.data.max_range / 100.0
    config.registration.max_num_threads = threads
    odometry = KissICP(config)

    def step(scan: LidarScan) -> Array:
        odometry.register_frame(scan.points.astype(np.float64), np.array([]))
        return np.array(odometry.last_pose)

    return step


class Naive:
    """SIFT on the intensity image, from scan to scan."""

    def __init__(self) -> None:
        self._sift, self._last = cv2.SIFT.create(1000), None
        self._pose, self._rng = np.eye(4), np.random.default_rng(0)

    def __call__(self, scan: LidarScan) -> Array:
        """Takes the next scan."""
        live = self._keypoints(scan)
        if self._last is not None:
            pairs = cv2.BFMatcher().knnMatch(live[1], self._last[1], k=2)
            good = [m for m, n in pairs if m.distance < 0.8 * n.distance]
            here, there = live[0][[m.queryIdx for m in good]], self._last[0][[m.trainIdx for m in good]]
            self._pose = self._pose @ self._motion(here, there)
        self._last = live
        return self._pose

    def _keypoints(self, scan: LidarScan) -> tuple[Array, NDArray[np.float32]]:
        """Points (N, 3) at SIFT keypoints, and their descriptors (N, 128)."""
        p = scan.points.astype(np.float64)
        azimuth, distance = np.arctan2(p[:, 1], p[:, 0]), np.linalg.norm(p, axis=1)
        row = np.minimum(np.cumsum(np.diff(azimuth % (2 * np.pi), prepend=0.0) < -np.pi), _ROWS - 1)
        column = ((np.pi - azimuth) / (2 * np.pi) * _COLUMNS).astype(np.int64) % _COLUMNS
        bright, index = np.zeros((_ROWS, _COLUMNS)), np.full((_ROWS, _COLUMNS), -1)
        bright[row, column], index[row, column] = scan.intensity * distance, np.arange(len(p))
        image = np.clip(255.0 * bright / np.percentile(bright[bright > 0], 97), 0, 255).astype(np.uint8)
        found, descriptors = self._sift.detectAndCompute(image, None)
        u, v = np.rint([k.pt for k in found]).astype(np.int64).T
        at = index[np.minimum(v, _ROWS - 1), np.minimum(u, _COLUMNS - 1)]
        return p[at[at >= 0]], descriptors[at >= 0]

    def _motion(self, here: Array, there: Array) -> Array:
        """The motion that takes most of the points to within 0.3 m of each other."""
        if len(here) < 3:
            return np.eye(4)
        chosen = self._rng.integers(0, len(here), (500, 3))
        candidates = rigid(here[chosen], there[chosen])
        near = np.linalg.norm(geometry.apply(candidates, here) - there, axis=-1) < 0.3
        best = near[np.argmax(near.sum(axis=1))]
        return rigid(here[None, best], there[None, best])[0] if best.sum() >= 3 else np.eye(4)


@dataclass(frozen=True, slots=True)
class Run:
    """Poses (N, 4, 4), and milliseconds (N,) of the processor and by the clock."""

    poses: Array
    processor: Array
    clock: Array


def run(step: Step, scans: list[LidarScan]) -> Run:
    """One drive."""
    poses, processor, clock = [], [], []
    for scan in scans:
        begin, begin_clock = time.process_time(), time.perf_counter()
        poses.append(step(scan).copy())
        processor.append(1e3 * (time.process_time() - begin))
        clock.append(1e3 * (time.perf_counter() - begin_clock))
    return Run(np.array(poses), np.array(processor), np.array(clock))


def _rows(recording: LidarRecording) -> list[list[object]]:
    scans = list(recording)
    ways: dict[str, tuple[Step, Step]] = {
        "retraverse": (ours(), ours()),
        "KISS-ICP": (kiss_icp(1), kiss_icp(0)),
        "SIFT on intensity": (Naive(), Naive()),
    }
    rows: list[list[object]] = []
    for name, (alone, as_run) in ways.items():
        cv2.setNumThreads(1)
        one = run(alone, scans)
        cv2.setNumThreads(-1)
        many = run(as_run, scans)
        drift = measure_drift(many.poses, recording.poses_truth)
        times = float(np.median(one.processor)), float(np.median(many.clock))
        angle = float(np.degrees(drift.rotation))
        rows.append([recording.name, name, 100 * drift.end_point, angle, 100 * drift.frame_error, *times])
    return rows


def main() -> None:
    """Prints the table."""
    warm_up()
    rows: list[list[object]] = []
    for name in DRIVES:
        folder = recordings.folder() / name
        if folder.is_dir():
            rows += _rows(open_lidar_recording(folder))
    if not rows:
        print(f"no lidar recordings at {recordings.folder()}: set VTR_DATA")
        return
    columns = ["drive", "odometry", "end point, %", "end, degrees", "between scans, cm", "ms, 1 thread", "ms as run"]
    table.show("lidar odometry against the pseudo truth", columns, rows, note="times are medians a scan")


if __name__ == "__main__":
    main()
