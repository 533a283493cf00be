import numpy as np
import pytest

from common import geometry
from services.estimator.stereo import model
from tests.services.estimator.stereo.scene import CAMERA, landmarks

K = model.intrinsics(CAMERA)
RNG = np.random.default_rng(0)
POSES = [geometry.exp(RNG.normal(size=6) * [0.5, 0.2, 0.8, 0.1, 0.2, 0.1]) for _ in range(8)]


def _predict(m, T):
    out = np.zeros(3)
    return model.predict(m, T, K, out), out


@pytest.mark.parametrize("T", POSES)
def test_prediction_is_the_cameras_projection_of_the_moved_point(T):
    for m in landmarks(RNG, 20):
        point = CAMERA.triangulate([m[0], m[1], m[0] - m[2]])
        u, v, u_right = CAMERA.project(geometry.apply(T, point[None])[0])
        ratio, predicted = _predict(m, T)
        np.testing.assert_allclose(predicted, [u, v, u - u_right], atol=1e-9)
        assert ratio == pytest.approx(geometry.apply(T, point[None])[0, 2] / point[2])


def test_a_point_at_infinity_only_turns():
    m = np.array([200.0, 100.0, 0.0])
    far, turned = (
        _predict(m, geometry.exp([5.0, 0.0, 3.0, 0.0, 0.1, 0.0]))[1],
        _predict(m, geometry.exp([0, 0, 0, 0, 0.1, 0]))[1],
    )
    np.testing.assert_allclose(far, turned)
    assert far[2] == 0.0


@pytest.mark.parametrize("T", POSES)
def test_derivatives_equal_numeric_ones(T):
    step = 1e-6
    for m in landmarks(RNG, 10):
        by_pose, by_landmark = np.zeros((3, 6)), np.zeros((3, 3))
        model.derivatives(m, T, K, by_pose, by_landmark)
        for j in range(6):
            xi = np.eye(6)[j] * step
            slope = (_predict(m, geometry.exp(xi) @ T)[1] - _predict(m, geometry.exp(-xi) @ T)[1]) / (2 * step)
            np.testing.assert_allclose(by_pose[:, j], slope, rtol=1e-5, atol=1e-4)
        for j in range(3):
            e = np.eye(3)[j] * 1e-4
            slope = (_predict(m + e, T)[1] - _predict(m - e, T)[1]) / 2e-4
            np.testing.assert_allclose(by_landmark[:, j], slope, rtol=1e-5, atol=1e-6)


def test_landmarks_and_measurements_are_the_same_thing():
    m = landmarks(RNG, 30)
    R = np.diag([0.1, 0.2, 0.3]) ** 2
    points = CAMERA.triangulate(np.stack([m[:, 0], m[:, 1], m[:, 0] - m[:, 2]], -1))
    back = np.linalg.inv(_by_point(points))
    uvd, covariances = model.as_uvd(points, back @ R @ back.transpose(0, 2, 1), K)
    np.testing.assert_allclose(uvd, m, atol=1e-9)
    np.testing.assert_allclose(covariances, np.broadcast_to(R, covariances.shape), atol=1e-9)


def _by_point(points):
    """Derivatives of (u, v, d) by the point."""
    J = CAMERA.jacobian(points)
    J[:, 2] = J[:, 0] - J[:, 2]
    return J
