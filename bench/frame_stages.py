"""Time of a frame by stage, and drift, of the stereo pipeline and of the naive way, in one run on the same images.

The naive way is ORB or SIFT on both images, brute-force matching, and ``cv2.solvePnPRansac`` from frame to frame. The
images are those of the KITTI recordings (``VTR_DATA``, else ``../shared/data``); where there are none, generated pairs,
of which only the times say something. Everything runs on one thread; times are of the processor, so that other work
counts little.
counts little.
"""

from __future__ import annotations

from collections import defaultdict
from time import process_time
from typing import NamedTuple

import cv2
import numpy as np

from bench import table
from bench.recordings import kitti
from common import geometry
from common.camera import StereoCamera
from services.estimator.offline import measure_drift
from services.estimator.stereo import (
    StereoLocalizer,
    StereoOdometry,
    StereoSettings,
    brief,
    fast,
    local_map,
    stereo_matching,
    warm_up,
)
from services.estimator.stereo.settings import PreprocessingSettings
from services.sensors.recordings import StereoPair

Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]
Times = dict[str, list[float]]

_RECORDINGS = ("kitti06_gray_stereo", "kitti02_colour_stereo")


class _Drive(NamedTuple):
    name: str
    camera: StereoCamera
    pairs: list[StereoPair]
    truth: Array | None


def _drives() -> list[_Drive]:
    found = [recording for name in _RECORDINGS if (recording := kitti(name)) is not None]
    return [_Drive(r.name, r.camera, [_grey(pair) for pair in r], r.poses_truth) for r in found] or [_generated()]


def _grey(pair: StereoPair) -> StereoPair:
    """The pair as every way of this bench takes it."""
    left, right = (i if i.ndim == 2 else cv2.cvtColor(i, cv2.COLOR_RGB2GRAY) for i in (pair.left, pair.right))
    return StereoPair(pair.stamp_ns, np.asarray(left, np.uint8), np.asarray(right, np.uint8))


def _generated() -> _Drive:
    camera = StereoCamera(1241, 376, 718.0, 718.0, 607.0, 185.0, 0.54)
    texture = np.random.default_rng(0).integers(0, 255, (94, 320), dtype=np.uint8)
    wide = np.asarray(cv2.resize(texture, (1280, 376), interpolation=cv2.INTER_CUBIC), dtype=np.uint8)
    views = [np.ascontiguousarray(wide[:, x : x + 1241]) for x in range(30)]
    pairs = [StereoPair(i * 100_000_000, views[i], views[i + 9]) for i in range(20)]
    return _Drive("generated pairs", camera, pairs, None)


class _Clock:
    """Collects milliseconds under names."""

    def __init__(self) -> None:
        self.times: Times = defaultdict(list)
        self._begin = process_time()

    def start(self) -> None:
        self._begin = process_time()

    def lap(self, name: str) -> None:
        now = process_time()
        self.times[name].append(1e3 * (now - self._begin))
        self._begin = process_time()


def _features(pair: StereoPair, settings: PreprocessingSettings, clock: _Clock) -> None:
    """The parts of preprocessing, one by one."""
    clock.start()
    left = fast.detect(pair.left, settings.fast_threshold, cell=settings.cell, limit=settings.max_features)
    right = fast.detect(pair.right, settings.fast_threshold, cell=settings.cell, limit=None)
    clock.lap("feature: FAST, both images")
    matched, _ = stereo_matching.correspond(pair.left, pair.right, left, right, settings)
    clock.lap("stereo: correspondence, sub-pixel")
    smooth = np.asarray(cv2.GaussianBlur(pair.left, (0, 0), 2.0), dtype=np.uint8)
    brief.describe(smooth, np.ascontiguousarray(left[matched]))
    clock.lap("feature: BRIEF")


def _pipeline(camera: StereoCamera, pairs: list[StereoPair]) -> tuple[Array, Times]:
    settings = StereoSettings()
    warm_up(camera, settings)
    odometry, localizer, clock = StereoOdometry(camera, settings), StereoLocalizer(camera, settings), _Clock()
    poses, keyframe, T_odom_keyframe = [], None, np.eye(4)
    for pair in pairs:
        _features(pair, settings.preprocessing, clock)
        clock.start()
        result = odometry.process(pair.left, pair.right, pair.stamp_ns)
        clock.lap("odometry, whole frame")
        # The stages inside are wall-clock times: the module takes them for health reports.
        clock.times["match: active search, refinement"].append(result.milliseconds["match"])
        clock.times["solve: RANSAC, Gauss-Newton"].append(result.milliseconds["solve"])
        poses.append(result.T_odom_live)
        if keyframe is not None:
            prior = geometry.inverse(T_odom_keyframe) @ result.T_odom_live
            sigma = np.diag(np.repeat([0.1, 0.02], 3) ** 2)
            clock.start()
            localizer.localize(keyframe, result.frame, geometry.Uncertain(prior, sigma))
            clock.lap("localization, one vertex")
        keyframe, T_odom_keyframe = local_map(result.frame.features, settings.mapping), result.T_odom_live
    return np.array(poses), clock.times


class _Way(NamedTuple):
    """A kind of features that OpenCV has: how it is called, its detector, and how its descriptors are compared."""

    name: str
    detector: cv2.Feature2D
    norm: int


def _points(pair: StereoPair, camera: StereoCamera, way: _Way, clock: _Clock) -> tuple[Array, Array, Array]:
    """Pixels (N, 2), descriptors (N, D) and points (N, 3) of features with a stereo match."""
    clock.start()
    (left, found_left), (right, found_right) = (way.detector.detectAndCompute(i, None) for i in (pair.left, pair.right))
    clock.lap(f"feature: {way.name}, both images")
    matches = cv2.BFMatcher(way.norm, crossCheck=True).match(found_left, found_right)
    a = np.array([left[m.queryIdx].pt for m in matches])
    b = np.array([right[m.trainIdx].pt for m in matches])
    good = (np.abs(a[:, 1] - b[:, 1]) < 2.0) & (a[:, 0] - b[:, 0] > 1.0)
    measurements = np.column_stack([a[good], b[good, 0]])
    descriptors = found_left[[m.queryIdx for m in matches]][good]
    clock.lap("stereo: brute force")
    return a[good], descriptors, camera.triangulate(measurements)


def _naive(camera: StereoCamera, pairs: list[StereoPair], way: _Way) -> tuple[Array, Times]:
    clock, pose = _Clock(), np.eye(4)
    K = np.array([[camera.fx, 0.0, camera.cx], [0.0, camera.fy, camera.cy], [0.0, 0.0, 1.0]])
    last = _points(pairs[0], camera, way, clock)
    poses = [pose]
    for pair in pairs[1:]:
        begin = process_time()
        live = _points(pair, camera, way, clock)
        clock.start()
        matches = cv2.BFMatcher(way.norm, crossCheck=True).match(last[1], live[1])
        points = np.array([last[2][m.queryIdx] for m in matches])
        pixels = np.array([live[0][m.trainIdx] for m in matches])
        clock.lap("match: brute force")
        found, turn, shift, _ = cv2.solvePnPRansac(
            points, pixels, K, None, flags=cv2.SOLVEPNP_P3P, reprojectionError=2.0
        )
        clock.lap("solve: solvePnPRansac")
        clock.times["odometry, whole frame"].append(1e3 * (process_time() - begin))
        if found:
            pose = pose @ geometry.inverse(geometry.transform(geometry.so3_exp(turn[:, 0]), shift[:, 0]))
        poses.append(pose)
        last = live
    return np.array(poses), clock.times


def _rows(way: str, times: Times) -> list[list[object]]:
    return [[way, stage, float(np.median(values)), float(np.percentile(values, 95))] for stage, values in times.items()]


def _compare(drive: _Drive) -> None:
    """The times of every way on one drive, and their drift."""
    naive = (
        _Way("ORB-1000", cv2.ORB.create(1000), cv2.NORM_HAMMING),
        _Way("SIFT-1000", cv2.SIFT.create(1000), cv2.NORM_L2),
    )
    ways = {"retraverse": _pipeline(drive.camera, drive.pairs)}
    for way in naive:
        ways[f"{way.name} + BFMatcher + solvePnPRansac"] = _naive(drive.camera, drive.pairs, way)
    rows = [row for way, (_, times) in ways.items() for row in _rows(way, times)]
    size = f"{drive.camera.width}x{drive.camera.height}"
    title = f"stereo frame by stage: {drive.name}, {len(drive.pairs)} pairs of {size}, one thread"
    table.show(title, ["way", "stage", "median ms", "p95 ms"], rows)
    if drive.truth is None:
        return
    figures: list[list[object]] = []
    for way, (poses, times) in ways.items():
        drift = measure_drift(poses, drive.truth)
        milliseconds = float(np.median(times["odometry, whole frame"]))
        figures.append([way, 100 * drift.end_point, 100 * drift.frame_error, milliseconds])
    columns = ["way", "drift at the end, %", "median between frames, cm", "median ms a frame"]
    table.show(f"stereo odometry: error on {drive.name}", columns, figures)


def main() -> None:
    """Prints times and errors of the ways."""
    cv2.setNumThreads(1)
    for drive in _drives():
        _compare(drive)


if __name__ == "__main__":
    main()
