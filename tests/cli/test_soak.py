"""What a long drive is judged by, without a robot."""

import tomllib

import numpy as np
import pytest

from cli.soak.drive import Drive
from cli.soak.network import Network, world_tables
from cli.soak.report import offsets_from, report, table


def circle(radius, count=2000):
    angle = np.linspace(0.0, 2.0 * np.pi, count)
    return radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)


def test_a_place_is_as_far_from_the_network_as_from_its_nearest_route():
    paths = [circle(10.0), circle(11.0)]
    places = np.array([[10.02, 0.0], [0.0, 10.9], [-9.7, 0.0]])
    assert offsets_from(paths, places) == pytest.approx([0.02, 0.1, 0.3], abs=1e-3)


def test_the_report_has_every_figure():
    seen = Drive(goals=3, reached=2, interventions=["north: lost"], kills={"tracker": 2, "router": 1})
    seen.stops = {"state": 1}
    seen.truth = [(10.0 + 0.01 * (k % 2), 0.001 * k, k > 10) for k in range(100)]
    seen.memory = {"estimator": [(1.0, 60), (20.0, 100), (31.0, 80), (60.0, 103)], "sensors": [(1.0, 200), (60.0, 190)]}
    data = report(Network(["a"], [circle(10.0)]), seen, 1.0, [])
    assert (data["goals"], data["reached"], data["network_m"]) == (3, 2, pytest.approx(62.8, abs=0.1))
    assert data["stops"] == {"state": 1}
    assert data["memory_growth"] == {"estimator": 0.03, "sensors": -0.05}
    assert 0.0 < data["lateral_rms_m"] < data["lateral_max_m"] < 0.02
    assert data["kilometres"] == pytest.approx(0.001, abs=0.001)
    assert table(data).row_count == len(data)


def test_a_drive_that_followed_nothing_has_no_errors():
    assert report(Network(["a"], [circle(10.0)]), Drive(), 1.0, [])["lateral_max_m"] is None


def test_the_world_has_room_for_its_route():
    scene = tomllib.loads(world_tables(320.0, 0.03))["sensors"]["world"]["scene"]
    assert scene["route_length"] == 320.0
    assert scene["extent"] > 160.0
    assert scene["trees"] > 40
