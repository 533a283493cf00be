"""Covariances are as large as the errors: NEES within its 95 % band in the rendered world."""

from datetime import UTC, datetime

import numpy as np
import pytest
from scipy.stats import chi2

from common import geometry
from common.geometry import Uncertain
from services.estimator.offline import Route, process
from services.estimator.offline.consistency import nees, of_edges, of_localization, of_odometry
from services.estimator.settings import Settings
from services.sensors.world import World, WorldSettings
from services.sensors.world.traversal import DrivingSettings, Traversal


def test_nees_of_drawn_errors_is_the_dimension():
    rng = np.random.default_rng(0)
    root = np.diag([0.01, 0.02, 0.03, 0.001, 0.002, 0.003])
    T = geometry.exp([1.0, 2.0, 0.5, 0.1, 0.2, 0.3])
    drawn = [nees(Uncertain(geometry.exp(root @ rng.normal(size=6)) @ T, root @ root.T), T) for _ in range(500)]
    assert np.mean(drawn) == pytest.approx(6.0, abs=0.5)


@pytest.fixture(scope="module")
def driven():
    world, drives = World(WorldSettings(clouds=0.0)), []
    for seed, hour in enumerate((9, 12)):
        settings = DrivingSettings(spacing=0.15, length=24.0)
        traversal = Traversal.of(world, datetime(2026, 6, 21, hour, tzinfo=UTC), settings, seed)
        drives.append(list(process(traversal, Settings())))
    route = Route(world.camera)
    route.teach(drives[0])
    return route, drives


@pytest.mark.long
@pytest.mark.parametrize("what", ["odometry", "edges", "localization"])
def test_errors_are_as_large_as_their_covariance_says(driven, what):
    route, drives = driven
    values = {
        "odometry": lambda: np.concatenate([of_odometry(d, route.camera.T_vehicle_camera) for d in drives]),
        "edges": lambda: of_edges(route),
        "localization": lambda: of_localization(route, drives[1]),
    }[what]()
    low, high = chi2.ppf([0.025, 0.975], 6 * len(values)) / len(values)
    assert len(values) >= 20
    assert low <= values.mean() <= high
