"""One good set of rendered pairs, and the folder of it, for every test that needs some."""

import pytest

from tests.services.sensors.calibration.scenes import render_set


@pytest.fixture(scope="session")
def good_set():
    """14 pairs, named ``000`` to ``013``."""
    return render_set(14)
