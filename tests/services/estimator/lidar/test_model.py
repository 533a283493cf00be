import numpy as np

from common import geometry
from services.estimator.lidar import model

RNG = np.random.default_rng(0)
POINTS = RNG.normal(size=(40, 3)) * [20.0, 20.0, 3.0]
T = geometry.exp([0.4, -0.2, 0.1, 0.02, -0.03, 0.3])


def _predict(point, pose):
    moved, out = np.zeros(3), np.zeros(3)
    assert model.predict(point, pose, moved, out)
    return moved, out


def test_points_and_measurements_are_the_same_thing():
    np.testing.assert_allclose(model.to_points(model.to_measurements(POINTS)), POINTS, atol=1e-12)
    for point in POINTS:
        _, out = _predict(point, T)
        np.testing.assert_allclose(out, model.to_measurements(geometry.apply(T, point[None]))[0], atol=1e-12)


def test_derivatives_are_those_of_finite_differences():
    by_pose, by_landmark, difference = np.zeros((3, 6)), np.zeros((3, 3)), np.zeros(3)
    h = 1e-6
    for point in POINTS:
        model.derivatives(_predict(point, T)[0], T, by_pose, by_landmark)
        for j in range(6):
            xi = h * np.eye(6)[j]
            ahead, behind = (_predict(point, geometry.exp(s * xi) @ T)[1] for s in (1.0, -1.0))
            model.difference(ahead, behind, difference)
            np.testing.assert_allclose(by_pose[:, j], difference / (2 * h), rtol=1e-5, atol=1e-7)
        for j in range(3):
            e = h * np.eye(3)[j]
            model.difference(_predict(point + e, T)[1], _predict(point - e, T)[1], difference)
            np.testing.assert_allclose(by_landmark[:, j], difference / (2 * h), rtol=1e-5, atol=1e-7)


def test_the_points_derivatives_undo_those_of_the_measurement():
    by_pose, by_landmark = np.zeros((3, 6)), np.zeros((3, 3))
    for point in POINTS:
        model.derivatives(point, np.eye(4), by_pose, by_landmark)
        J = model.point_jacobians(model.to_measurements(point))
        np.testing.assert_allclose(J @ by_landmark, np.eye(3), atol=1e-9)


def test_azimuths_differ_the_short_way_round():
    out = np.zeros(3)
    model.difference(np.array([3.1, 0.1, 5.0]), np.array([-3.1, 0.0, 4.0]), out)
    np.testing.assert_allclose(out, [6.2 - 2 * np.pi, 0.1, 1.0])


def test_the_lidar_itself_has_no_direction():
    assert not model.predict(np.zeros(3), np.eye(4), np.zeros(3), np.zeros(3))
