import numpy as np
import pytest

from services.estimator.solving.covariance import sandwich

ROBUST = 1e4


def _line(rng, count, places, error):
    """Scores of a line's fit with unit noise assumed, and what its estimate was off by."""
    x = rng.uniform(-1.0, 1.0, count)
    J = np.stack([np.ones(count), x], -1)
    H = J.T @ J
    step = np.linalg.solve(H, J.T @ error)
    scores = J * (error - J @ step)[:, None]
    # Three errors a measurement are assumed; a line has one.
    return H, scores, places, step


@pytest.mark.parametrize("noise", [0.3, 1.0, 3.0])
def test_the_noise_is_the_one_that_was_observed(noise):
    rng = np.random.default_rng(0)
    places = rng.uniform(0, 4000, (400, 2))
    got, true = [], []
    for _ in range(200):
        H, scores, places, step = _line(rng, 400, places, noise * rng.normal(size=400))
        got.append(np.trace(sandwich(H, np.zeros((2, 2)), scores, places, ROBUST)))
        true.append(step @ step)
    # A part of the answer is what was assumed, a variance of 1.
    expected = (400 * noise**2 + 30) / 430 / noise**2
    assert np.mean(got) / np.mean(true) == pytest.approx(expected, rel=0.2)


def test_neighbours_that_err_together_count_less():
    rng = np.random.default_rng(1)
    groups, size = 60, 8
    places = np.repeat(rng.uniform(0, 4000, (groups, 2)), size, axis=0)
    got, naive, true = [], [], []
    for _ in range(200):
        H, scores, places, step = _line(rng, groups * size, places, np.repeat(rng.normal(size=groups), size))
        got.append(np.trace(sandwich(H, np.zeros((2, 2)), scores, places, ROBUST)))
        naive.append(np.trace(np.linalg.inv(H)))
        true.append(step @ step)
    assert np.mean(true) > 2.0 * np.mean(naive)
    assert np.mean(got) == pytest.approx(np.mean(true), rel=0.2)


def test_what_was_known_before_takes_part():
    rng = np.random.default_rng(2)
    H, scores, places, _ = _line(rng, 100, rng.uniform(0, 4000, (100, 2)), rng.normal(size=100))
    known = 1e8 * np.eye(2)
    np.testing.assert_allclose(sandwich(H, known, scores, places, ROBUST), 1e-8 * np.eye(2), rtol=1e-3, atol=1e-14)
