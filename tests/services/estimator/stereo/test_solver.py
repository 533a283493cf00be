import numpy as np
import pytest

from common import geometry
from common.camera import StereoCamera
from common.geometry import Uncertain
from services.estimator.stereo import model, solver
from services.estimator.stereo.settings import MatchingSettings
from tests.services.estimator.stereo.scene import CAMERA, landmarks

SETTINGS = MatchingSettings()
SIGMA_LANDMARK = np.array([0.1, 0.1, 0.25])
SIGMA_LIVE = np.array([0.25, 0.25, 0.25])


def _world(rng, T, count=150, camera=CAMERA, **depths):
    """Measurements of landmarks in the map's frame and in the live one, with noise."""
    k = model.intrinsics(camera)
    m = landmarks(rng, count, camera=camera, **depths)
    live = np.zeros_like(m)
    ahead = [model.predict(m[i], T, k, live[i]) > 0.05 for i in range(count)]
    m, live = m[ahead], live[ahead]
    stored = m + rng.normal(size=m.shape) * SIGMA_LANDMARK
    live = live + rng.normal(size=m.shape) * SIGMA_LIVE
    covariances = np.tile(np.diag(SIGMA_LANDMARK**2), (len(m), 1, 1))
    return (stored, covariances), (live, np.tile(np.diag(SIGMA_LIVE**2), (len(m), 1, 1)))


def _solve(world, start=None, camera=CAMERA, **options):
    return solver.solve(*world, np.eye(4) if start is None else start, model.intrinsics(camera), SETTINGS, **options)


@pytest.mark.parametrize("seed", range(6))
def test_a_known_motion_is_recovered_among_outliers(seed):
    rng = np.random.default_rng(seed)
    T = geometry.exp(rng.normal(size=6) * [0.3, 0.1, 0.6, 0.03, 0.1, 0.03])
    world = _world(rng, T)
    wrong = rng.permutation(len(world[0][0]))[: int(0.4 * len(world[0][0]))]
    world[1][0][wrong, :2] += rng.uniform(8, 60, (len(wrong), 2)) * rng.choice([-1, 1], (len(wrong), 2))
    solution = _solve(world)
    error = geometry.log(solution.T_live_map.T @ geometry.inverse(T))
    assert np.linalg.norm(error[:3]) < 0.02
    assert np.linalg.norm(error[3:]) < 0.003
    assert not solution.inliers[wrong].any()
    assert solution.inliers.sum() > 0.9 * (len(world[0][0]) - len(wrong))


def _nees(draw, rounds=200):
    rng = np.random.default_rng(10)
    nees = []
    for _ in range(rounds):
        T = geometry.exp(rng.normal(size=6) * [0.2, 0.1, 0.4, 0.02, 0.05, 0.02])
        solution = _solve(draw(rng, T), start=T)
        error = geometry.log(T @ geometry.inverse(solution.T_live_map.T))
        nees.append(error @ np.linalg.solve(solution.T_live_map.covariance, error))
    # The mean of 200 chi-square values of 6 degrees of freedom has a standard deviation of 0.25.
    return np.mean(nees)


def test_independent_errors_are_covered_and_little_more():
    """What is assumed of neighbours, that they may share their errors, makes the covariance somewhat modest."""
    assert 4.0 < _nees(lambda rng, T: _world(rng, T, count=100)) < 7.0


def test_errors_that_neighbours_share_are_covered_too():
    def draw(rng, T, cell=40):
        stored, (live, noise) = _world(rng, T, count=100)
        shared = rng.normal(size=(20, 20, 3)) * SIGMA_LIVE * 1.5
        at = (live[:, :2] // cell).astype(int) % 20
        return stored, (live + shared[at[:, 0], at[:, 1]], noise)

    assert 4.0 < _nees(draw) < 8.0


def test_noise_twice_as_large_as_set_is_noticed():
    rng = np.random.default_rng(11)
    T = geometry.exp([0.1, 0.0, 0.5, 0.0, 0.02, 0.0])
    (stored, covariances), (live, noise) = _world(rng, T, count=400)
    honest = _solve(((stored, covariances), (live, noise)))
    misled = _solve(((stored, covariances / 4.0), (live, noise / 4.0)))
    ratio = np.trace(misled.T_live_map.covariance[:3, :3]) / np.trace(honest.T_live_map.covariance[:3, :3])
    assert 0.7 < ratio < 1.4


def test_far_structure_does_not_stretch_the_motion():
    """A turn among structure of 25 to 120 m, whose disparities are of 3 to 15 pixels."""
    camera = StereoCamera(1241, 376, 718.0, 718.0, 607.0, 185.0, 0.537)
    rng = np.random.default_rng(12)
    T = geometry.inverse(geometry.exp([0.0, 0.0, 1.0, 0.0, 0.07, 0.0]))
    along = []
    for _ in range(60):
        solution = _solve(_world(rng, T, 200, camera, near=25.0, far=120.0), T, camera)
        along.append(geometry.inverse(solution.T_live_map.T)[2, 3])
    true = geometry.inverse(T)[2, 3]
    assert np.mean(along) == pytest.approx(true, abs=3 * np.std(along) / np.sqrt(60) + 0.005)
    assert abs(np.mean(along) / true - 1.0) < 0.02


def test_an_error_of_all_disparities_is_found_and_does_not_stretch_the_motion():
    camera = StereoCamera(1241, 376, 718.0, 718.0, 607.0, 185.0, 0.537)
    rng = np.random.default_rng(13)
    T = geometry.inverse(geometry.exp([0.0, 0.0, 1.2, 0.0, 0.01, 0.0]))
    x = [], []
    for _ in range(40):
        (stored, covariances), measured = _world(rng, T, 250, camera, near=12.0, far=80.0)
        for uvd in (stored, measured[0]):
            uvd[:, 2] += -0.5 + 0.8 * ((uvd[:, 0] - camera.cx) / camera.fx) ** 2
        world = (stored, covariances), measured
        solution = _solve(world, T, camera, rectification=np.diag([0.4, 1.0]) ** 2)
        x[0].append([*solution.rectification, geometry.inverse(solution.T_live_map.T)[2, 3]])
        x[1].append(geometry.inverse(_solve(world, T, camera).T_live_map.T)[2, 3])
    offset, curvature, along = np.mean(x[0], axis=0)
    assert offset == pytest.approx(-0.5, abs=0.15)
    assert curvature == pytest.approx(0.8, abs=0.3)
    assert abs(along / 1.2 - 1.0) < 0.005
    assert np.mean(x[1]) / 1.2 - 1.0 > 0.01, "without the estimate the same data overestimate the motion"


def test_a_prior_takes_part_by_its_covariance():
    rng = np.random.default_rng(14)
    T = geometry.exp([0.1, 0.0, 0.3, 0.0, 0.02, 0.0])
    world = _world(rng, T)
    off = geometry.exp([0.05, 0.0, 0.0, 0.0, 0.0, 0.0]) @ T
    sure = _solve(world, prior=Uncertain(off, 1e-10 * np.eye(6)))
    vague = _solve(world, prior=Uncertain(off, 1e4 * np.eye(6)))
    np.testing.assert_allclose(sure.T_live_map.T, off, atol=1e-3)
    np.testing.assert_allclose(vague.T_live_map.T, _solve(world).T_live_map.T, atol=1e-5)


@pytest.mark.parametrize("count", [0, 2])
def test_too_few_landmarks_give_no_pose(count):
    rng = np.random.default_rng(15)
    (stored, covariances), (live, noise) = _world(rng, np.eye(4), 20)
    world = (stored[:count], covariances[:count]), (live[:count], noise[:count])
    assert _solve(world) is None


def test_landmarks_that_agree_on_nothing_give_few_inliers():
    rng = np.random.default_rng(16)
    (stored, covariances), (_, noise) = _world(rng, np.eye(4), 60)
    random = landmarks(rng, len(stored))
    solution = _solve(((stored, covariances), (random, noise)))
    assert solution is None or solution.inliers.sum() < 10
