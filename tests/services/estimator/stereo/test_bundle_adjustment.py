from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import least_squares

from common import geometry
from services.estimator.stereo import model
from services.estimator.stereo.bundle_adjustment import Problem, adjust
from services.estimator.stereo.settings import BundleSettings
from tests.services.estimator.stereo.scene import CAMERA, landmarks

K = model.intrinsics(CAMERA)
SETTINGS = BundleSettings(iterations=20)
SIGMA = np.array([0.15, 0.15, 0.2])
STEP = geometry.inverse(geometry.exp([0.01, 0.0, 0.3, 0.0, 0.03, 0.0]))


def _simulate(rng, count=80, keyframes=4, noise=1.0, offset=0.0, step=STEP, camera=CAMERA, **depths):
    """A window over a known motion; every landmark is anchored in the first keyframe, or one later if seen there."""
    k = model.intrinsics(camera)
    truth = np.array([np.linalg.matrix_power(step, i) for i in range(keyframes)])
    first = landmarks(rng, count, camera=camera, **depths)
    anchors = rng.integers(0, keyframes - 1, count)
    uvd, of, by, measured = first.copy(), [], [], []
    seen = np.zeros(3)
    for i in range(count):
        for j in range(anchors[i] + 1, keyframes):
            if model.predict(first[i], truth[j] @ geometry.inverse(truth[anchors[i]]), k, seen) > 0.05:
                of.append(i)
                by.append(j)
                measured.append(seen.copy())
    of, by, measured = np.array(of), np.array(by), np.array(measured)
    drawn = [x + noise * rng.normal(size=x.shape) * SIGMA for x in (uvd, measured)]
    for x in drawn:
        x[:, 2] += offset
    R = np.diag(SIGMA**2)
    problem = Problem(
        T_keyframes_first=truth.copy(),
        anchors=anchors,
        uvd=drawn[0],
        covariances=np.tile(R, (count, 1, 1)),
        landmarks=of,
        keyframes=by,
        measured=drawn[1],
        noise=np.tile(R, (len(of), 1, 1)),
        rectification=np.diag([0.4, 1.0]) ** 2 if offset else 1e-10 * np.eye(2),
    )
    return problem, truth, first


def _disturbed(problem, rng, size=0.02):
    moved = (
        geometry.exp(rng.normal(size=(len(problem.T_keyframes_first) - 1, 6)) * size) @ problem.T_keyframes_first[1:]
    )
    return replace(problem, T_keyframes_first=np.concatenate([problem.T_keyframes_first[:1], moved]))


def _error(adjusted, truth, keyframe=-1):
    return geometry.log(truth[keyframe] @ geometry.inverse(adjusted.T_keyframes_first[keyframe]))


def test_without_noise_the_truth_is_recovered():
    rng = np.random.default_rng(0)
    problem, truth, first = _simulate(rng, noise=0.0)
    adjusted = adjust(_disturbed(problem, rng), K, SETTINGS)
    np.testing.assert_allclose(adjusted.T_keyframes_first, truth, atol=1e-6)
    np.testing.assert_allclose(adjusted.uvd, first, atol=1e-4)
    assert adjusted.errors2.max() < 1e-6


def test_it_is_the_dense_least_squares_solution():
    """Almost without robustness, against a general solver over all unknowns at once.

    The rectification is taken as known: against what is known of it the measurements count by the noise's scale, which
    the general solver does not estimate.
    """
    rng = np.random.default_rng(1)
    problem, _, _ = _simulate(rng, count=12, keyframes=3)
    adjusted = adjust(problem, K, replace(SETTINGS, robust_scale=1e4))

    def residuals(x):
        poses = np.concatenate([np.eye(4)[None], geometry.exp(x[:12].reshape(2, 6)) @ problem.T_keyframes_first[1:]])
        uvd = x[12:].reshape(-1, 3)
        out = [((problem.uvd - uvd) / SIGMA).ravel()]
        for i, j, z in zip(problem.landmarks, problem.keyframes, problem.measured, strict=True):
            seen = np.zeros(3)
            model.predict(uvd[i], poses[j] @ geometry.inverse(poses[problem.anchors[i]]), K, seen)
            out.append((z - seen) / SIGMA)
        return np.concatenate(out)

    start = np.concatenate([np.zeros(12), problem.uvd.ravel()])
    dense = least_squares(residuals, start, x_scale="jac", xtol=1e-12, ftol=1e-12, gtol=1e-12)
    expected = geometry.exp(dense.x[:12].reshape(2, 6)) @ problem.T_keyframes_first[1:]
    np.testing.assert_allclose(adjusted.T_keyframes_first[1:], expected, atol=2e-5)
    np.testing.assert_allclose(adjusted.uvd, dense.x[12:].reshape(-1, 3), atol=5e-3)


def test_a_window_beats_the_chain_of_its_motions():
    rng = np.random.default_rng(2)
    chained, together = [], []
    for _ in range(25):
        problem, truth, _ = _simulate(rng, keyframes=5)
        together.append(_error(adjust(problem, K, SETTINGS), truth))
        T = np.eye(4)
        for j in range(4):
            T = _pair(problem, j) @ T
        chained.append(geometry.log(truth[-1] @ geometry.inverse(T)))
    rms = [np.sqrt(np.mean(np.square(e), axis=0)) for e in (together, chained)]
    assert (rms[0] < rms[1]).all()
    assert np.linalg.norm(rms[0][:3]) < 0.8 * np.linalg.norm(rms[1][:3])


def _pair(problem, j):
    """Motion from keyframe j to the next by the landmarks that both measured alone."""
    rows = problem.keyframes == j + 1
    uvd, cov, measured, noise = [], [], [], []
    for o in np.flatnonzero(rows):
        i = problem.landmarks[o]
        if problem.anchors[i] == j:
            uvd.append(problem.uvd[i])
        else:
            uvd.extend(problem.measured[(problem.landmarks == i) & (problem.keyframes == j)])
        cov.append(np.diag(SIGMA**2))
        measured.append(problem.measured[o])
        noise.append(problem.noise[o])
    count = len(measured)
    alone = Problem(
        np.array([np.eye(4), STEP]), np.zeros(count, int), np.array(uvd), np.array(cov), np.arange(count),
        np.ones(count, int), np.array(measured), np.array(noise), 1e-10 * np.eye(2),
    )  # fmt: skip
    return adjust(alone, K, SETTINGS).T_keyframes_first[1]


def test_covariances_of_poses_and_landmarks_are_those_of_the_errors():
    rng = np.random.default_rng(3)
    poses, points = [], []
    for _ in range(60):
        problem, truth, first = _simulate(rng, count=150)
        adjusted = adjust(problem, K, SETTINGS)
        error, covariance = _error(adjusted, truth), adjusted.pose(3).covariance
        poses.append(error @ np.linalg.solve(covariance, error))
        seen = np.zeros(3)
        for i in np.flatnonzero(np.isfinite(adjusted.newest[:, 0]))[::10]:
            if model.predict(first[i], truth[3] @ geometry.inverse(truth[problem.anchors[i]]), K, seen) > 0.05:
                error = seen - adjusted.newest[i]
                points.append(error @ np.linalg.solve(adjusted.newest_covariances[i], error))
    # Independent errors are covered with some modesty: neighbours are assumed to share a part of theirs.
    assert 4.0 < np.mean(poses) < 7.3
    assert 2.5 < np.mean(points) < 3.5


def test_outliers_do_not_matter():
    rng = np.random.default_rng(4)
    problem, truth, _ = _simulate(rng)
    clean = np.linalg.norm(_error(adjust(problem, K, SETTINGS), truth)[:3])
    measured = problem.measured.copy()
    wrong = rng.permutation(len(measured))[: len(measured) // 5]
    measured[wrong, :2] += rng.uniform(5, 30, (len(wrong), 2)) * rng.choice([-1, 1], (len(wrong), 2))
    adjusted = adjust(replace(problem, measured=measured), K, SETTINGS)
    assert np.linalg.norm(_error(adjusted, truth)[:3]) < 2.5 * clean + 0.01
    assert np.median(adjusted.errors2[wrong]) > 100.0


def test_an_error_of_all_disparities_is_found():
    rng = np.random.default_rng(5)
    found = []
    for _ in range(10):
        problem, _, _ = _simulate(rng, count=200, keyframes=5, offset=0.4, near=3.0, far=30.0)
        found.append(adjust(problem, K, SETTINGS).rectification[0])
    assert np.mean(found) == pytest.approx(0.4, abs=0.15)


def test_nothing_to_adjust_is_no_result():
    rng = np.random.default_rng(6)
    problem, _, _ = _simulate(rng)
    none = np.zeros(0, int)
    empty = replace(problem, landmarks=none, keyframes=none, measured=np.zeros((0, 3)), noise=np.zeros((0, 3, 3)))
    assert adjust(empty, K, SETTINGS) is None
    assert adjust(replace(problem, T_keyframes_first=np.eye(4)[None]), K, SETTINGS) is None
    loose = problem.keyframes != 3
    untied = replace(
        problem,
        landmarks=problem.landmarks[loose],
        keyframes=problem.keyframes[loose],
        measured=problem.measured[loose],
        noise=problem.noise[loose],
    )
    assert adjust(untied, K, SETTINGS) is None
