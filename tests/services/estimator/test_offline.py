from dataclasses import dataclass

import cv2
import numpy as np
import pytest

from common import geometry
from common.camera import StereoCamera
from services.estimator.offline import measure_drift, run_localization, run_odometry
from tests.services.estimator.stereo.scene import CAMERA, render


@dataclass
class Pair:
    stamp_ns: int
    left: np.ndarray
    right: np.ndarray


@dataclass
class Drive:
    """A recording in memory."""

    camera: StereoCamera
    pairs: list[Pair]
    poses_truth: np.ndarray | None

    def __iter__(self):
        return iter(self.pairs)


def _drive(poses, seed=0):
    pairs = [Pair(i * 100_000_000, *render(T, seed=seed + i)) for i, T in enumerate(poses)]
    return Drive(CAMERA, pairs, np.array(poses))


def _real(folder):
    """A folder of pairs, read here by the simplest means."""
    files = [sorted((folder / side).glob("*.png")) for side in ("left", "right")]
    images = [[cv2.imread(str(f), cv2.IMREAD_GRAYSCALE) for f in side] for side in files]
    name, rows = ("calib.txt", (0, 1)) if (folder / "calib.txt").exists() else ("calib_kitti.txt", (2, 3))
    lines = [line.split(":")[-1].split() for line in (folder / name).read_text().splitlines()]
    left, right = (np.array(lines[r], float).reshape(3, 4) for r in rows)
    offsets = [np.linalg.solve(P[:, :3], P[:, 3]) for P in (left, right)]
    height, width = images[0][0].shape
    baseline = offsets[0][0] - offsets[1][0]
    camera = StereoCamera(width, height, left[0, 0], left[1, 1], left[0, 2], left[1, 2], baseline)
    truth = np.tile(np.eye(4), (len(files[0]), 1, 1))
    truth[:, :3] = np.loadtxt(folder / "poses.txt").reshape(-1, 3, 4)
    X = geometry.transform(np.eye(3), offsets[0])
    pairs = [Pair(i * 100_000_000, *p) for i, p in enumerate(zip(*images, strict=True))]
    return Drive(camera, pairs, X @ truth @ geometry.inverse(X))


STEP = geometry.exp([0.02, 0.0, 0.12, 0.0, 0.012, 0.0])
PATH = [np.linalg.matrix_power(STEP, i) for i in range(10)]


def test_odometry_over_a_recording():
    drive, seen = _drive(PATH), []
    run = run_odometry(drive, on_frame=lambda: seen.append(1))
    assert run.success.all()
    assert len(seen) == len(run.poses) == len(run.milliseconds) == 10
    drift = measure_drift(run.poses, drive.poses_truth)
    assert drift.length == pytest.approx(1.09, abs=0.02)
    assert drift.end_point < 0.03


def test_drift_ignores_where_the_world_begins_and_counts_the_end():
    truth = np.array([geometry.transform(np.eye(3), [0.0, 0.0, z]) for z in range(11)])
    moved = geometry.exp([3.0, 2.0, 1.0, 0.1, 0.5, 0.2]) @ truth
    assert measure_drift(moved, truth).end_point == pytest.approx(0.0, abs=1e-12)
    stretched = truth.copy()
    stretched[:, 2, 3] *= 1.02
    drift = measure_drift(stretched, truth)
    assert (drift.end_point, drift.frame_error) == pytest.approx((0.02, 0.02))


def test_a_parallel_path_is_localized_on_the_taught_one():
    aside = [T @ geometry.exp([0.1, 0.0, 0.05, 0.0, -0.03, 0.0]) for T in PATH]
    run = run_localization(_drive(PATH), _drive(aside, seed=100))
    assert run.coverage == 1.0
    assert len(run.dropouts) == 0
    assert np.median(run.position_errors) < 0.02
    assert run.position_errors.max() < 0.05
    np.testing.assert_allclose(run.poses[-1][:3, 3], aside[-1][:3, 3], atol=0.06)


def test_pairs_in_the_dark_are_a_dropout_and_no_wrong_pose():
    live = _drive(PATH, seed=50)
    for i in (4, 5):
        live.pairs[i].left = live.pairs[i].right = np.zeros_like(live.pairs[i].left)
    run = run_localization(_drive(PATH), live)
    assert run.success.tolist() == [True] * 4 + [False] * 2 + [True] * 4
    assert run.reasons[4]
    assert len(run.dropouts) == 1
    assert run.dropouts[0] == pytest.approx(2 * 0.1217, abs=0.05)
    assert run.position_errors.max() < 0.1


def test_a_teach_without_features_is_refused():
    dark = _drive(PATH[:2])
    for pair in dark.pairs:
        pair.left = pair.right = np.zeros_like(pair.left)
    with pytest.raises(ValueError, match="features"):
        run_localization(dark, _drive(PATH[:2]))


@pytest.mark.parametrize(
    ("name", "end_point", "frame_error"),
    [
        ("kitti06_gray_stereo", 0.010, 0.011),
        ("kitti02_colour_stereo", 0.012, 0.020),
    ],
)
def test_drift_on_real_recordings(data_dir, name, end_point, frame_error):
    drive = _real(data_dir / name)
    run = run_odometry(drive)
    drift = measure_drift(run.poses, drive.poses_truth)
    assert run.success.all()
    assert drift.end_point <= end_point
    assert drift.frame_error <= frame_error


@pytest.mark.parametrize("name", ["kitti06_gray_stereo", "kitti02_colour_stereo"])
def test_odd_pairs_are_localized_against_even_ones(data_dir, name):
    drive = _real(data_dir / name)
    halves = [Drive(drive.camera, drive.pairs[i::2], drive.poses_truth[i::2]) for i in (0, 1)]
    run = run_localization(*halves)
    assert run.coverage == 1.0
    assert np.median(run.position_errors) <= 0.03
    assert run.position_errors.max() <= 0.1
