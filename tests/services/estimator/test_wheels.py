"""Wheel odometry between frames: what was driven, with an uncertainty that covers what wheels cannot know."""

import numpy as np
import pytest

from common import geometry
from services.estimator.wheels import WheelMotion, WheelSettings


@pytest.fixture
def wheels():
    return WheelMotion(WheelSettings())


def test_steady_driving_is_an_arc(wheels):
    wheels.step((1.0, 0.5), 0.1)
    T_last_live = np.eye(4)
    for _ in range(20):
        T_last_live = T_last_live @ wheels.step((1.0, 0.5), 0.1).T
    radius, angle = 2.0, 1.0
    assert geometry.yaw_of(T_last_live) == pytest.approx(angle)
    assert T_last_live[:2, 3] == pytest.approx([radius * np.sin(angle), radius * (1 - np.cos(angle))])


def test_speeding_up_between_frames_counts_half(wheels):
    wheels.step((0.0, 0.0), 0.1)
    assert wheels.step((1.0, 0.0), 0.1).T[0, 3] == pytest.approx(0.05)


@pytest.mark.parametrize(("twist", "seconds"), [(None, 0.1), ((1.0, 0.0), 0.0), ((1.0, 0.0), -1.0), ((1.0, 0.0), 3.0)])
def test_it_says_nothing_where_the_wheels_do_not(wheels, twist, seconds):
    wheels.step((1.0, 0.0), 0.1)
    assert wheels.step(twist, seconds) is None


def test_a_missing_reading_is_not_bridged(wheels):
    wheels.step((1.0, 0.0), 0.1)
    wheels.step(None, 0.1)
    assert wheels.step((1.0, 0.0), 0.1) is None
    assert wheels.step((1.0, 0.0), 0.1) is not None


def test_slip_is_within_the_uncertainty(wheels):
    wheels.step((1.0, 0.3), 0.1)
    driven = wheels.step((1.0, 0.3), 0.1)
    slipped = geometry.exp(np.array([0.95, 0, 0, 0, 0, 0.3 * 0.93]) * 0.1)
    error = geometry.log(slipped @ geometry.inverse(driven.T))
    assert error @ np.linalg.solve(driven.covariance, error) < 6.0
