import numpy as np
import pytest

from common import geometry
from common.geometry import Uncertain
from services.estimator.lidar import model, ransac, solver
from services.estimator.lidar.settings import MatchingSettings

SETTINGS = MatchingSettings()
T_TRUE = geometry.exp([0.6, -0.1, 0.03, 0.01, -0.02, 0.15])
NOISE = np.diag([0.004, 0.004, 0.03]) ** 2


def drawn(rng, count, outliers=0.0):
    """Points, their covariances, live measurements and theirs, both noisy."""
    points = rng.normal(size=(count, 3)) * [15.0, 15.0, 2.0] + [0, 0, 1.0]
    exact = model.to_measurements(points)
    errors = rng.multivariate_normal(np.zeros(3), NOISE, (2, count))
    J = model.point_jacobians(exact)
    live = model.to_measurements(geometry.apply(T_TRUE, points)) + errors[1]
    wrong = rng.random(count) < outliers
    live[wrong] = model.to_measurements(rng.normal(size=(wrong.sum(), 3)) * [15.0, 15.0, 2.0])
    return (model.to_points(exact + errors[0]), J @ NOISE @ J.transpose(0, 2, 1)), (
        live, np.broadcast_to(NOISE, (count, 3, 3)).copy()), wrong  # fmt: skip


def test_rigid_motions_of_three_points():
    rng = np.random.default_rng(0)
    a = rng.normal(size=(20, 3, 3)) * 10
    T = ransac.rigid(a, geometry.apply(T_TRUE, a))
    np.testing.assert_allclose(T, np.broadcast_to(T_TRUE, T.shape), atol=1e-9)
    assert geometry.is_transform(ransac.rigid(a, rng.normal(size=a.shape)))


@pytest.mark.parametrize("outliers", [0.0, 0.4, 0.7])
def test_the_true_motion_is_found_among_outliers(outliers):
    rng = np.random.default_rng(1)
    landmarks, measured, wrong = drawn(rng, 200, outliers)
    solution = solver.solve(landmarks, measured, np.eye(4), SETTINGS)
    error = geometry.log(solution.T_live_map.T @ geometry.inverse(T_TRUE))
    assert np.linalg.norm(error[:3]) < 0.05
    assert np.linalg.norm(error[3:]) < 0.005
    assert (solution.inliers & wrong).sum() <= 0.05 * wrong.sum() + 1
    assert solution.inliers[~wrong].mean() > 0.9


def test_the_covariance_is_honest():
    rng = np.random.default_rng(2)
    nees = []
    for _ in range(60):
        landmarks, measured, _ = drawn(rng, 150, 0.2)
        solution = solver.solve(landmarks, measured, T_TRUE, SETTINGS)
        error = geometry.log(solution.T_live_map.T @ geometry.inverse(T_TRUE))
        nees.append(error @ np.linalg.solve(solution.T_live_map.covariance, error))
    # Six degrees of freedom; taking errors of neighbours as shared makes it cautious.
    assert 2.0 < np.mean(nees) < 8.0


def test_a_prior_takes_part_as_a_measurement():
    rng = np.random.default_rng(3)
    landmarks, measured, _ = drawn(rng, 60)
    off = geometry.exp([0.02, 0.0, 0.0, 0.0, 0.0, 0.0]) @ T_TRUE
    held = solver.solve(landmarks, measured, T_TRUE, SETTINGS, Uncertain(off, 1e-10 * np.eye(6)))
    np.testing.assert_allclose(held.T_live_map.T, off, atol=1e-3)
    free = solver.solve(landmarks, measured, T_TRUE, SETTINGS, Uncertain(off, 1e4 * np.eye(6)))
    assert np.abs(free.T_live_map.T - off).max() > 3e-3


def test_no_motion_without_agreement():
    rng = np.random.default_rng(4)
    landmarks, measured, _ = drawn(rng, 100)
    assert (
        solver.solve((landmarks[0][:2], landmarks[1][:2]), (measured[0][:2], measured[1][:2]), T_TRUE, SETTINGS) is None
    )
    shuffled = measured[0][rng.permutation(100)]
    solution = solver.solve(landmarks, (shuffled, measured[1]), np.eye(4), SETTINGS)
    assert solution is None or solution.inliers.sum() < 15
