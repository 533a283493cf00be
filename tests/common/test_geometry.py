from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import expm
from scipy.spatial.transform import RigidTransform, Rotation

from common import geometry as se3
from common.geometry import Uncertain


def hat(xi):
    out = np.zeros((4, 4))
    out[:3, :3], out[:3, 3] = se3.skew(xi[3:]), xi[:3]
    return out


coordinate = st.floats(-50, 50)
direction = (
    st.tuples(*[st.floats(-1, 1)] * 3)
    .filter(lambda v: np.linalg.norm(v) > 1e-3)
    .map(lambda v: np.array(v) / np.linalg.norm(v))
)
angle = st.one_of(
    st.floats(0, np.pi - 1e-6), st.floats(0, 1e-3), st.floats(np.pi - 1e-3, np.pi - 1e-9), st.sampled_from([0.0, 1e-4])
)
twist = st.builds(
    lambda rho, axis, size: np.concatenate([rho, axis * size]), st.tuples(*[coordinate] * 3), direction, angle
)


@given(twist)
def test_exp_is_the_matrix_exponential(xi):
    assert se3.exp(xi) == pytest.approx(expm(hat(xi)), abs=1e-9)


@given(twist)
def test_exp_agrees_with_scipy(xi):
    rotation = Rotation.from_rotvec(xi[3:])
    assert se3.so3_exp(xi[3:]) == pytest.approx(rotation.as_matrix(), abs=1e-12)
    exponential = np.concatenate([xi[3:], xi[:3]])
    assert se3.exp(xi) == pytest.approx(RigidTransform.from_exp_coords(exponential).as_matrix(), abs=1e-9)


@given(twist)
def test_log_undoes_exp_near_zero_and_near_pi(xi):
    assert se3.log(se3.exp(xi)) == pytest.approx(xi, abs=1e-5)
    assert se3.exp(se3.log(se3.exp(xi))) == pytest.approx(se3.exp(xi), abs=1e-9)


@given(direction)
def test_log_of_a_half_turn_is_a_half_turn(axis):
    rotation = 2 * np.outer(axis, axis) - np.eye(3)
    phi = se3.so3_log(rotation)
    assert np.linalg.norm(phi) == pytest.approx(np.pi)
    assert se3.so3_exp(phi) == pytest.approx(rotation, abs=1e-9)


@pytest.mark.parametrize("size", [0.0, 1e-12, 1e-9, 1e-6, 0.99e-4, 1e-4, 1.01e-4, 1e-3])
def test_small_angles_keep_their_digits(size):
    phi = size * np.array([0.6, -0.8, 0.0])
    assert se3.so3_log(se3.so3_exp(phi)) == pytest.approx(phi, rel=1e-9, abs=1e-16)


@given(twist, twist)
def test_inverse_and_composition(a, b):
    A, B = se3.exp(a), se3.exp(b)
    assert se3.inverse(A) @ A == pytest.approx(np.eye(4), abs=1e-9)
    assert se3.inverse(A) == pytest.approx(np.linalg.inv(A), abs=1e-9)
    assert se3.inverse(A @ B) == pytest.approx(se3.inverse(B) @ se3.inverse(A), abs=1e-9)


@given(twist, twist)
def test_adjoint_moves_a_twist_through_a_transform(a, xi):
    T = se3.exp(a)
    assert hat(se3.adjoint(T) @ xi) == pytest.approx(T @ hat(xi) @ se3.inverse(T), abs=1e-8)
    assert se3.adjoint(T) @ se3.adjoint(se3.inverse(T)) == pytest.approx(np.eye(6), abs=1e-8)


@given(twist, st.lists(st.tuples(coordinate, coordinate, coordinate), min_size=1, max_size=5))
def test_apply_is_the_homogeneous_product(a, points):
    T, homogeneous = se3.exp(a), np.hstack([points, np.ones((len(points), 1))])
    assert se3.apply(T, points) == pytest.approx((T @ homogeneous.T).T[:, :3], abs=1e-9)


def test_every_function_carries_stacks_through():
    rng = np.random.default_rng(1)
    xi = rng.normal(size=(2, 3, 6))
    T = se3.exp(xi)
    for function, argument in [
        (se3.exp, xi), (se3.log, T), (se3.inverse, T), (se3.adjoint, T), (se3.normalize, T), (se3.yaw_of, T),
        (se3.rotation_angle, T), (se3.so3_exp, xi[..., 3:]), (se3.so3_log, T[..., :3, :3]), (se3.skew, xi[..., :3]),
    ]:  # fmt: skip
        stacked = function(argument)
        assert stacked.shape[:2] == (2, 3)
        for i, j in np.ndindex(2, 3):
            assert stacked[i, j] == pytest.approx(function(argument[i, j]), abs=1e-12), function.__name__
    points = rng.normal(size=(2, 3, 7, 3))
    assert se3.apply(T, points)[1, 2] == pytest.approx(se3.apply(T[1, 2], points[1, 2]))
    assert se3.exp(np.zeros((0, 6))).shape == (0, 4, 4)
    assert se3.log(np.zeros((0, 4, 4))).shape == (0, 6)


@given(twist, st.floats(-0.02, 0.02))
def test_normalize_returns_the_nearest_rigid_transform(xi, noise):
    T = se3.exp(xi)
    bent = T.copy()
    bent[:3, :3] += noise * np.arange(9).reshape(3, 3) / 9
    assert se3.is_transform(se3.normalize(bent), 1e-9)
    assert se3.normalize(T) == pytest.approx(T, abs=1e-9)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, 1e300, 2.0, -1.0])
@pytest.mark.parametrize("place", [(0, 0), (2, 2), (3, 3), (1, 0)])
def test_a_matrix_with_a_wrong_number_is_no_transform(value, place):
    T = np.stack([np.eye(4)] * 2)
    assert se3.is_transform(T)
    T[(1, *place)] = value
    assert not se3.is_transform(T)


def test_a_reflection_is_no_transform():
    assert not se3.is_transform(np.diag([1.0, 1.0, -1.0, 1.0]))
    assert not se3.is_transform(np.eye(3))


@given(coordinate, coordinate, st.floats(-3.1, 3.1))
def test_poses_of_the_plane(x, y, yaw):
    T = se3.from_xy_yaw(x, y, yaw)
    assert T[:3, 3] == pytest.approx([x, y, 0])
    assert se3.yaw_of(T) == pytest.approx(yaw, abs=1e-12)
    assert se3.rotation_angle(T) == pytest.approx(abs(yaw), abs=1e-9)


def _covariance(rng, scale):
    root = rng.normal(size=(6, 6))
    return scale * (root @ root.T + np.eye(6))


def _drawn(rng, mean, covariance, count=40_000):
    return se3.exp(rng.multivariate_normal(np.zeros(6), covariance, count)) @ mean


def _spread(samples, mean):
    return np.cov(se3.log(samples @ se3.inverse(mean)), rowvar=False)


def test_composition_and_inverse_carry_the_covariance_that_monte_carlo_finds():
    rng = np.random.default_rng(4)
    a = Uncertain(se3.exp([2.0, -1.0, 0.5, 0.3, -0.8, 1.2]), _covariance(rng, 1e-6))
    b = Uncertain(se3.exp([-1.0, 3.0, 0.2, -1.1, 0.4, 0.2]), _covariance(rng, 2e-6))
    first, second = _drawn(rng, a.T, a.covariance), _drawn(rng, b.T, b.covariance)
    both, back = a @ b, a.inverse()
    for estimate, samples in [(both, first @ second), (back, se3.inverse(first))]:
        found = _spread(samples, estimate.T)
        assert np.linalg.norm(found - estimate.covariance) < 0.03 * np.linalg.norm(found)


def test_certain_transforms_compose_exactly():
    T = se3.exp([1, 2, 3, 0.1, 0.2, 0.3])
    a = Uncertain.exactly(T)
    assert pytest.approx(np.eye(4)) == (a @ a.inverse()).T
    assert not (a @ a).covariance.any()
    assert pytest.approx(T) == (Uncertain.identity() @ a).T


def test_mahalanobis_distance_follows_chi_squared():
    rng = np.random.default_rng(5)
    T, covariance = se3.exp([4.0, 1.0, 0.0, 0.2, 0.1, 1.0]), _covariance(rng, 1e-5)
    draws = zip(_drawn(rng, T, covariance, 500), _drawn(rng, T, covariance, 500), strict=True)
    distances = [Uncertain(x, covariance).mahalanobis2(Uncertain(y, covariance)) for x, y in draws]
    assert np.mean(distances) == pytest.approx(6.0, rel=0.1)
