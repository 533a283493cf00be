import numpy as np
import pytest

from common import geometry
from common.geometry import Uncertain
from services.estimator.stereo import ImageError, StereoOdometry
from tests.services.estimator.stereo.scene import CAMERA, render

STEP = geometry.exp([0.01, 0.0, 0.1, 0.0, 0.01, 0.0])
POSES = [np.linalg.matrix_power(STEP, i) for i in range(8)]
DT = 100_000_000
BLACK = np.zeros((CAMERA.height, CAMERA.width), np.uint8)


@pytest.fixture(scope="module")
def pairs():
    return [render(T, seed=i) for i, T in enumerate(POSES)]


def _error(T, truth):
    return np.linalg.norm((geometry.inverse(truth) @ T)[:3, 3])


def test_a_curve_is_followed(pairs):
    odometry = StereoOdometry(CAMERA)
    results = [odometry.process(*pair, i * DT) for i, pair in enumerate(pairs)]
    assert all(r.success for r in results)
    assert _error(results[-1].T_odom_live, POSES[-1]) < 0.02
    for result, previous in zip(results[1:], results, strict=False):
        step = geometry.inverse(previous.T_odom_live) @ result.T_odom_live
        np.testing.assert_allclose(result.T_previous_live.T, step, atol=1e-6)
        assert _error(result.T_previous_live.T, STEP) < 0.015
        assert np.linalg.eigvalsh(result.T_previous_live.covariance)[0] > 0.0


def test_a_repeated_pair_is_no_motion(pairs):
    odometry = StereoOdometry(CAMERA)
    results = [odometry.process(*pairs[0], i * DT) for i in range(4)]
    assert all(r.success for r in results)
    assert _error(results[-1].T_odom_live, np.eye(4)) < 1e-3


@pytest.mark.parametrize("kind", ["black", "constant", "noise"])
def test_blind_pairs_fail_honestly_and_the_motion_goes_on_after_them(pairs, kind):
    odometry = StereoOdometry(CAMERA)
    for i in range(4):
        odometry.process(*pairs[i], i * DT)
    rng = np.random.default_rng(0)
    noise = [rng.integers(0, 256, BLACK.shape, dtype=np.uint8) for _ in range(2)]
    blind = {"black": (BLACK, BLACK), "constant": (BLACK + 90, BLACK + 90), "noise": noise}[kind]
    covariances = []
    for i in (4, 5):
        result = odometry.process(*blind, i * DT)
        assert not result.success
        assert result.reason
        covariances.append(np.trace(result.T_keyframe_live.covariance))
        assert _error(result.T_odom_live, POSES[i]) < 0.1, "the constant velocity is carried on"
    assert covariances[1] > covariances[0]
    result = odometry.process(*pairs[6], 6 * DT)
    assert result.success
    assert _error(result.T_odom_live, POSES[6]) < 0.03


def test_pairs_that_were_dropped_are_bridged(pairs):
    odometry = StereoOdometry(CAMERA)
    for i in (0, 1, 2, 6, 7):
        result = odometry.process(*pairs[i], i * DT)
        assert result.success
    assert _error(result.T_odom_live, POSES[7]) < 0.03


def test_a_prior_of_the_wheels_is_used_where_images_say_nothing(pairs):
    odometry = StereoOdometry(CAMERA)
    odometry.process(*pairs[0], 0)
    prior = Uncertain(STEP, 1e-4 * np.eye(6))
    result = odometry.process(BLACK, BLACK, DT, prior)
    assert not result.success
    np.testing.assert_allclose(result.T_previous_live.T, STEP, atol=1e-9)


def test_a_start_in_the_dark_waits_for_light(pairs):
    odometry = StereoOdometry(CAMERA)
    assert not odometry.process(BLACK, BLACK, 0).success
    assert odometry.process(*pairs[0], DT).success
    assert odometry.process(*pairs[1], 2 * DT).inliers > 30


def test_a_new_scene_is_taken_up_after_some_failures(pairs):
    odometry = StereoOdometry(CAMERA)
    odometry.process(*pairs[0], 0)
    elsewhere = geometry.transform(geometry.so3_exp([0.0, 2.6, 0.0]), [1.0, 0.0, 3.0])
    outcomes = [odometry.process(*render(elsewhere, seed=i), (i + 1) * DT).success for i in range(8)]
    assert not outcomes[0]
    assert outcomes[-1]


def test_stamps_that_stand_still_or_go_back_raise_nothing(pairs):
    odometry = StereoOdometry(CAMERA)
    for stamp, pair in zip((0, DT, DT, 0), pairs, strict=False):
        assert np.isfinite(odometry.process(*pair, stamp).T_odom_live).all()


def test_an_image_of_another_size_is_refused_and_changes_nothing(pairs):
    odometry = StereoOdometry(CAMERA)
    odometry.process(*pairs[0], 0)
    with pytest.raises(ImageError):
        odometry.process(BLACK[:100], BLACK[:100], DT)
    assert odometry.process(*pairs[1], DT).success
