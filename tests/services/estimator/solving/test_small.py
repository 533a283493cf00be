import numpy as np
import pytest

from common import geometry
from services.estimator.solving import small

RNG = np.random.default_rng(0)
POSE = geometry.exp([0.3, -0.2, 0.5, 0.1, -0.05, 0.2])


def test_perturbation_is_the_exponential_map():
    for _ in range(20):
        xi = RNG.normal(size=6) * RNG.choice([1e-7, 1e-2, 1.0])
        np.testing.assert_allclose(small.perturb(POSE, xi), geometry.exp(xi) @ POSE, atol=1e-12)


def test_the_small_inverse_and_the_quadratic_form():
    a = RNG.normal(size=(3, 3))
    s, out, e = a @ a.T + np.eye(3), np.zeros((3, 3)), RNG.normal(size=3)
    assert small.invert3(s, out)
    np.testing.assert_allclose(out, np.linalg.inv(s), atol=1e-12)
    assert small.quadratic3(e, s) == pytest.approx(e @ s @ e)
    assert not small.invert3(np.zeros((3, 3)), out)
    assert not small.invert3(np.full((3, 3), np.nan), out)
