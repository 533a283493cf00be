"""One renderer and one good set of rendered pairs for every test that needs some."""

import pytest

from services.sensors.calibration.simulation import BoardRenderer, simulated_rig


@pytest.fixture(scope="session")
def renderer():
    return BoardRenderer(simulated_rig())


@pytest.fixture(scope="session")
def good_set(renderer):
    """14 pairs, named ``000`` to ``013``."""
    return renderer.pairs(14)
