import math

import numpy as np
import pytest

from common.geometry import from_xy_yaw
from services.tracker.simulation import lay_route


@pytest.fixture(scope="session")
def curves():
    """A route of 60 m with curves of 4 to 6 m radius, both ways: pieces for `lay_route`."""
    return [(8, 0), (9, 9 / 4), (3, 0), (12, -3), (10, 10 / 6), (3, 0), (8, -8 / 5), (7, 0)]


@pytest.fixture(scope="session")
def taught():
    """Makes a taught route: poses (N, 4, 4) of its vertices with the noise of visual odometry."""

    def make(pieces, noise=0.004, seed=3):
        rng = np.random.default_rng(seed)
        exact = lay_route(pieces, 0.4)
        shaken = [
            from_xy_yaw(*noise * rng.standard_normal(2), math.radians(0.2) * rng.standard_normal()) for _ in exact
        ]
        return exact @ np.array(shaken)

    return make
