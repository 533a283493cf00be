"""One whole robot for all tests that need one: its start takes longer than most of them."""

import pytest

from tests.integration.whole_robot import WholeRobot


@pytest.fixture(scope="session")
def robot(tmp_path_factory):
    with WholeRobot(tmp_path_factory.mktemp("robot")) as robot:
        yield robot
