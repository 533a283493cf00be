"""A router that all tests of the bus share, and sessions that end with their test."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator

import pytest

from common.bus import Bus
from tests.processes import Robot


@pytest.fixture(scope="session")
def robot(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Robot]:
    with Robot(tmp_path_factory.mktemp("robot")) as started:
        yield started


@pytest.fixture
def connect(robot: Robot) -> Iterator[Callable[[str], Bus]]:
    """Opens a session as a process of the robot."""
    with contextlib.ExitStack() as sessions:
        yield lambda process: sessions.enter_context(
            Bus("r1", process, robot.endpoint, shared_memory=False, timeout=10)
        )
