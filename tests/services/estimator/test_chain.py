"""The localization chain follows the robot along a route, on odometry and on localizations."""

import numpy as np
import pytest

from common import geometry
from common.geometry import Uncertain
from services.estimator.chain import ChainSettings, LocalizationChain
from tests.services.estimator.driving import Drive

STANDING = [0.0] * 6


def _arc(count, step, radius):
    """Vertices of a circular route, as poses in the first one's frame."""
    T_step = geometry.exp([step, 0.0, 0.0, 0.0, 0.0, step / radius])
    path = [np.eye(4)]
    for _ in range(count - 1):
        path.append(path[-1] @ T_step)
    return np.array(path)


def test_odometry_alone_moves_the_trunk_to_the_nearest_vertex():
    path = _arc(80, 0.4, 6.0)
    chain, drive = LocalizationChain(path), Drive(keyframe_every=4)
    chain.move(drive.on(STANDING))
    chain.start(0)
    T_world_live = np.eye(4)
    for _ in range(300):
        step = geometry.exp([0.1, 0.0, 0.0, 0.0, 0.0, 0.1 / 6.0])
        T_world_live = T_world_live @ step
        chain.move(drive.on(step))
        nearest = int(np.argmin(np.linalg.norm(path[:, :3, 3] - T_world_live[:3, 3], axis=1)))
        assert abs(chain.trunk - nearest) <= 1
        assert np.allclose(path[chain.trunk] @ chain.T_trunk_leaf().T, T_world_live, atol=1e-9)
    assert chain.metres_since_success == pytest.approx(30.0, rel=1e-3)


def test_a_localization_replaces_dead_reckoning_and_its_uncertainty():
    chain, drive = LocalizationChain(_arc(20, 0.4, 6.0)), Drive(variance=1e-4)
    chain.start(0)
    for _ in range(20):
        chain.move(drive.on([0.1, 0, 0, 0, 0, 0]))
    before = np.trace(chain.T_trunk_leaf().covariance)
    T_trunk_leaf = Uncertain(geometry.exp([0.05, 0.1, 0, 0, 0, 0.02]), np.diag([1e-6] * 6))
    chain.localize(T_trunk_leaf)
    assert chain.localized
    assert chain.metres_since_success == 0.0
    assert np.trace(chain.T_trunk_leaf().covariance) < before
    assert chain.branch <= chain.trunk


def test_a_route_that_crosses_itself_does_not_make_the_trunk_jump():
    # A figure of eight: two circles that touch at the crossing.
    left, right = _arc(95, 0.4, 6.0), _arc(95, 0.4, -6.0)
    path = np.concatenate([left, left[-1] @ right[1:]])
    chain, drive = LocalizationChain(path, ChainSettings()), Drive()
    chain.move(drive.on(STANDING))
    chain.start(0)
    trunks = []
    for i in range(len(path) - 1):
        chain.move(drive.on(geometry.inverse(path[i]) @ path[i + 1]))
        trunks.append(chain.trunk)
    assert trunks == list(range(1, len(path)))


def test_the_window_is_in_metres_and_stays_on_the_route():
    chain = LocalizationChain(_arc(50, 0.4, 6.0))
    chain.start(0)
    assert chain.window(2.0, 4.0).start == 0
    chain.start(25)
    window = chain.window(2.0, 4.0)
    assert (25 - window.start) * 0.4 == pytest.approx(2.0, abs=0.41)
    assert (window.stop - 1 - 25) * 0.4 == pytest.approx(4.0, abs=0.41)
    chain.start(49)
    assert chain.window(0.0, 10.0) == range(49, 50)
