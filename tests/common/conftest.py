"""A router that all tests of the bus share, and sessions that end with their test."""

from __future__ import annotations

import contextlib
import subprocess
import sys
import textwrap
from collections.abc import Callable, Iterator

import pytest

from common.bus import Bus
from tests.processes import ROOT, Robot


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


@pytest.fixture
def start(robot):
    """Starts a service whose ``main`` is the given Python text, in which ``service`` is the service."""
    processes = []

    def started(main: str, name: str = "sensors", config: str | None = None) -> subprocess.Popen[str]:
        script = (
            "import os, sys, threading, time\nfrom common.service import run\nfrom common import topics\n"
            f"def main(service):\n{textwrap.indent(textwrap.dedent(main), '    ')}\nrun({name!r}, main)\n"
        )
        command = [sys.executable, "-c", script, "--config", config or str(robot.config)]
        process = subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        processes.append(process)
        return process

    yield started
    for process in processes:
        process.kill()
        process.communicate()
