from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from common import geometry
from common.camera import OPTICAL_IN_VEHICLE, StereoCamera

CAMERA = StereoCamera(width=640, height=400, fx=410.0, fy=420.0, cx=321.0, cy=199.0, baseline=0.24)

points = st.lists(st.tuples(st.floats(-20, 20), st.floats(-20, 20), st.floats(0.5, 80)), min_size=1, max_size=6).map(
    np.array
)


@given(points)
def test_triangulation_undoes_projection(p):
    assert CAMERA.triangulate(CAMERA.project(p)) == pytest.approx(p, rel=1e-7, abs=1e-7)


@given(points)
def test_the_jacobian_is_the_numeric_derivative(p):
    step = 1e-6 * np.eye(3)
    numeric = np.stack(
        [(CAMERA.project(p + d * p[:, 2:]) - CAMERA.project(p - d * p[:, 2:])) / (2e-6 * p[:, 2:]) for d in step],
        axis=-1,
    )
    assert CAMERA.jacobian(p) == pytest.approx(numeric, rel=1e-5, abs=1e-4)


def test_stacks_of_points_are_projected_alike():
    p = np.random.default_rng(0).uniform(1, 5, (2, 4, 3))
    assert CAMERA.project(p)[1, 2] == pytest.approx(CAMERA.project(p[1, 2]))
    assert CAMERA.jacobian(p)[1, 2] == pytest.approx(CAMERA.jacobian(p[1, 2]))


def test_a_point_ahead_of_the_vehicle_is_ahead_of_the_camera():
    ahead_and_left = geometry.apply(geometry.inverse(OPTICAL_IN_VEHICLE), [[10.0, 2.0, 1.0]])
    assert ahead_and_left[0] == pytest.approx([-2.0, -1.0, 10.0])
    u, v, right = CAMERA.project(ahead_and_left[0])
    assert u < CAMERA.cx
    assert v < CAMERA.cy
    assert right < u


def test_two_cameras_do_not_share_their_mounting():
    first, second = CAMERA, StereoCamera(640, 400, 410.0, 420.0, 321.0, 199.0, 0.24)
    assert first.T_vehicle_camera is not second.T_vehicle_camera
