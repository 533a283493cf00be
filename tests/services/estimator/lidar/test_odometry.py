"""Known motions of a lidar in a textured world, and real drives."""

from dataclasses import replace

import numpy as np
import pytest

from common import geometry
from common.geometry import Uncertain
from common.lidar import LidarScan
from services.estimator.lidar import LidarOdometry, LidarSettings, ScanError
from services.estimator.offline import measure_drift, run_lidar_odometry
from services.sensors.recordings import open_lidar_recording
from tests.services.estimator.lidar.scene import as_kitti, scan

SETTINGS = LidarSettings()
STEP = np.array([0.5, 0.02, 0.0, 0.0, 0.0, 0.04])
PERIOD = 100_000_000


def drive(scans, settings=SETTINGS, priors=None):
    odometry = LidarOdometry(settings)
    return [odometry.process(s, None if priors is None else priors[i]) for i, s in enumerate(scans)]


@pytest.mark.parametrize("form", [lambda s: s, as_kitti], ids=["organised", "points"])
def test_a_known_drive_is_measured_and_its_covariance_honest(form):
    rng = np.random.default_rng(0)
    nees = []
    for i in range(12):
        T = geometry.exp(rng.normal(size=6) * [0.5, 0.2, 0.05, 0.01, 0.01, 0.05])
        _, result = drive([form(scan(seed=2 * i)), form(scan(T, seed=2 * i + 1, stamp=PERIOD))])
        error = geometry.log(result.T_previous_live.T @ geometry.inverse(T))
        assert result.success
        assert np.linalg.norm(error[:3]) < 0.01
        assert np.linalg.norm(error[3:]) < 0.001
        nees.append(error @ np.linalg.solve(result.T_previous_live.covariance, error))
    assert 1.5 < np.mean(nees) < 12.0


def test_motion_within_a_turn_is_corrected():
    twist = np.array([8.0, 0.0, 0.0, 0.0, 0.0, 0.5])
    poses = [np.array(geometry.exp(0.1 * i * twist)) for i in range(6)]
    scans = [scan(T, twist=twist, seed=i, stamp=i * PERIOD) for i, T in enumerate(poses)]
    without = replace(SETTINGS, odometry=replace(SETTINGS.odometry, compensate=False))
    errors = []
    for settings in (SETTINGS, without):
        end = drive(scans, settings)[-1].T_odom_live
        errors.append(np.linalg.norm((geometry.inverse(poses[-1]) @ end)[:3, 3]))
    assert errors[0] < 0.015
    assert errors[0] < 0.5 * errors[1]


def test_an_error_of_the_velocity_feeds_nothing():
    """The stamp is at the end of a turn: a velocity told by the stamps' poses would swing to and fro for ever."""
    rng = np.random.default_rng(1)
    twist = np.array([1.2, 0.0, 0.0, 0.0, 0.0, 0.3])
    poses = [np.array(geometry.exp(0.1 * i * twist)) for i in range(8)]
    scans = [scan(T, twist=twist, seed=i, stamp=i * PERIOD, noise=0.05) for i, T in enumerate(poses)]
    told = twist + np.array([0.5, 0.0, 0.0, 0.0, 0.0, 0.2]) * rng.choice([-1, 1])
    priors = [None, Uncertain(geometry.exp(0.1 * told), np.diag(np.repeat([0.1, 0.05], 3) ** 2)), *[None] * 6]
    steps = np.array([geometry.log(r.T_previous_live.T) * 10 for r in drive(scans, priors=priors)[2:]])
    assert np.abs(steps - twist)[:, :2].max() < 0.1
    assert np.abs(steps - twist)[:, 5].max() < 0.02


def test_the_covariance_of_a_moving_lidar_is_honest():
    rng = np.random.default_rng(2)
    nees = []
    for drive_number in range(4):
        twist = np.array([rng.uniform(0.5, 8.0), 0.0, 0.0, 0.0, 0.0, rng.uniform(-0.5, 0.5)])
        poses = [np.array(geometry.exp(0.1 * i * twist)) for i in range(4)]
        scans = [scan(T, twist=twist, seed=10 * drive_number + i, stamp=i * PERIOD) for i, T in enumerate(poses)]
        result = drive(scans)[-1]
        T = geometry.exp(0.3 * twist)
        if result.keyframe == 0:
            error = geometry.log(result.T_keyframe_live.T @ geometry.inverse(T))
            nees.append(error @ np.linalg.solve(result.T_keyframe_live.covariance, error))
    assert len(nees) >= 2
    assert np.mean(nees) < 15.0


def test_a_keyframe_serves_until_the_lidar_is_far():
    poses = [np.array(geometry.exp(i * STEP)) for i in range(9)]
    results = drive([scan(T, seed=i, stamp=i * PERIOD) for i, T in enumerate(poses)])
    numbers = [r.keyframe for r in results]
    assert numbers == sorted(numbers)
    assert 1 <= numbers[-1] <= 3
    assert np.abs(results[-1].T_odom_live - poses[-1]).max() < 0.03


def test_a_prior_finds_a_motion_that_nobody_expects():
    T = np.array(geometry.exp([2.5, 0.0, 0.0, 0.0, 0.0, 0.6]))
    scans = [scan(seed=0), scan(seed=1, stamp=PERIOD), scan(T, seed=2, stamp=2 * PERIOD)]
    told = Uncertain(T @ geometry.exp([0.1, 0.05, 0, 0, 0, 0.02]), np.diag(np.repeat([0.2, 0.05], 3) ** 2))
    result = drive(scans, priors=[None, None, told])[-1]
    assert result.success
    assert np.abs(result.T_odom_live - T).max() < 0.03


def test_what_hides_the_ground_from_the_lidar_is_no_evidence_of_standing():
    """The vehicle's own shadow moves with it, and its outline looks the same in every scan."""
    hidden = np.zeros((64, 1024), dtype=bool)
    for middle in range(40, 1000, 120):
        hidden[44:56, middle : middle + 25 + middle % 17] = True
    poses = [np.array(geometry.exp(i * STEP * 2)) for i in range(4)]
    scans = []
    for i, T in enumerate(poses):
        s = scan(T, seed=i, stamp=i * PERIOD)
        scans.append(replace(s, points=np.where(hidden[..., None], np.float32(0.0), s.points)))
    results = drive(scans)
    assert all(r.success for r in results)
    assert np.abs(results[-1].T_odom_live - poses[-1]).max() < 0.05


def test_a_bad_scan_changes_nothing():
    scans = [scan(np.array(geometry.exp(i * STEP)), seed=i, stamp=i * PERIOD) for i in range(4)]
    odometry = LidarOdometry(SETTINGS)
    for i, s in enumerate(scans):
        if i == 2:
            for bad in (
                replace(s, intensity=0 * s.intensity),
                replace(s, points=np.nan * s.points),
                LidarScan(s.stamp_ns, s.points[:16], s.intensity[:16]),
                as_kitti(s),
            ):
                with pytest.raises(ScanError):
                    odometry.process(bad)
        result = odometry.process(s)
    assert result.success
    assert np.abs(result.T_odom_live - geometry.exp(3 * STEP)).max() < 0.03


def test_a_lidar_that_is_another_one_is_taken_on_after_a_while():
    odometry = LidarOdometry(SETTINGS)
    odometry.process(scan())
    other = [LidarScan(i * PERIOD, s.points[::2], s.intensity[::2]) for i, s in enumerate([scan(seed=1)] * 12)]
    refused = 0
    for s in other:
        try:
            odometry.process(s)
        except ScanError:
            refused += 1
    assert refused == 10


def test_a_lidar_that_was_carried_away_is_no_success():
    poses = [np.array(geometry.exp(i * STEP)) for i in range(2)]
    away = np.array(geometry.exp([-14.0, 0.0, 0.0, 0.0, 0.0, 2.0]))
    result = drive([scan(T, seed=i, stamp=i * PERIOD) for i, T in enumerate([*poses, away])])[-1]
    assert not result.success
    assert "landmarks" in result.reason
    # It goes on as before, and says how little it knows.
    assert np.abs(result.T_odom_live - geometry.exp(2 * STEP)).max() < 0.05
    assert result.T_previous_live.covariance[0, 0] > 1e-3


@pytest.mark.parametrize("name", ["lidar_kitti_city", "lidar_kitti_street22"])
@pytest.mark.parametrize("part", [slice(None), slice(1, None, 2)], ids=["all", "odd"])
def test_drift_on_real_drives(data_dir, name, part):
    recording = open_lidar_recording(data_dir / name).select(part)
    run = run_lidar_odometry(recording)
    drift = measure_drift(run.poses, recording.poses_truth)
    assert recording.truth == "pseudo truth"
    assert run.success.all()
    assert drift.end_point < 0.02
    assert np.degrees(drift.rotation) < 1.0
