"""The demo's judge: errors between paths are those a ruler would measure."""

import numpy as np
import pytest

from cli.demo.driver import Driver, DriverSettings
from cli.demo.errors import path_errors, settling_distance
from common import geometry


def circle(radius=10.0, count=400, turns=1.0):
    angles = np.linspace(0.0, 2.0 * np.pi * turns, count)
    return np.array([geometry.from_xy_yaw(radius * np.sin(a), radius * (1 - np.cos(a)), a) for a in angles])


def test_a_parallel_path_has_its_distance_as_lateral_error():
    taught = circle()
    shift = geometry.from_xy_yaw(0.0, 0.12, np.radians(3.0))
    errors = path_errors(taught, taught[::7] @ shift)
    assert np.allclose(errors.lateral, 0.12, atol=2e-3)
    assert np.allclose(np.degrees(errors.heading), 3.0, atol=0.5)
    assert errors.arclength[-1] == pytest.approx(2 * np.pi * 10.0, rel=0.02)


def test_driving_the_circle_twice_counts_its_length_twice():
    taught = circle(turns=2.0, count=800)
    errors = path_errors(taught, taught)
    assert errors.arclength[-1] == pytest.approx(4 * np.pi * 10.0, rel=1e-3)
    assert np.abs(errors.lateral).max() < 1e-3


def test_standing_still_in_the_teach_does_no_harm():
    taught = np.concatenate([[circle()[0]] * 50, circle(), [circle()[-1]] * 50])
    assert np.abs(path_errors(taught, circle()).lateral).max() < 1e-3


def test_settling_is_where_the_error_first_comes_within_the_bound():
    taught = np.array([geometry.from_xy_yaw(x, 0.0, 0.0) for x in np.linspace(0, 20, 200)])
    repeated = np.array([geometry.from_xy_yaw(x, 0.3 * np.exp(-x), 0.0) for x in np.linspace(0, 20, 500)])
    assert settling_distance(path_errors(taught, repeated)) == pytest.approx(np.log(6.0), abs=0.1)


def test_the_human_drives_the_whole_path_and_stops_at_its_end():
    angles = np.linspace(0.0, 1.5 * np.pi, 300)
    path = np.stack([8.0 * np.sin(angles), 8.0 * (1.0 - np.cos(angles)), angles], axis=1)
    driver, T, farthest = Driver(path, DriverSettings()), np.eye(4), 0.0
    for _ in range(2000):
        command = driver.command(T, 0.05)
        if command is None:
            break
        T = T @ geometry.exp([command[0] * 0.05, 0, 0, 0, 0, command[1] * 0.05])
        farthest = max(farthest, abs(np.hypot(T[0, 3], T[1, 3] - 8.0) - 8.0))
    assert command is None
    assert np.linalg.norm(T[:2, 3] - path[-1, :2]) < 0.15
    assert farthest < 0.15


def test_a_drive_that_begins_on_the_way_is_compared_with_that_part_of_the_path():
    taught = circle(count=401)
    errors = path_errors(taught, taught[250:300])
    assert np.abs(errors.lateral).max() < 1e-9
    assert errors.arclength[0] == pytest.approx(2 * np.pi * 10.0 * 250 / 400, abs=0.1)
