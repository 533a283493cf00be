"""What the web console costs: its share of a core for 20 browsers, and whether safety's loop notices.

A robot repeats in a graph of 10,000 vertices; router, safety and console are real processes, the others are acted. The
browsers are a process of their own: what they cost is theirs.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import psutil
from numpy.typing import NDArray

from bench.table import show
from common import topics
from common.camera import StereoCamera
from tests.processes import ROOT, Robot, every, free_port
from tests.services.console.acting import ActedRobot, network

Array = NDArray[np.float64]

_BROWSERS = 20
_VERTICES, _REPEATS = 2000, 4
_SECONDS = 12.0
_SETTLE_S = 4.0
_CAMERA = StereoCamera(640, 400, 425.0, 425.0, 319.5, 199.5, 0.24)


def main() -> None:
    """Measures without a console, with one that nobody looks at, with one browser, and with twenty."""
    with tempfile.TemporaryDirectory() as folder:
        port = free_port()
        with Robot(Path(folder), f"[console]\nport = {port}\n") as robot:
            robot.start("safety")
            acted = ActedRobot(robot, *network(_VERTICES, _REPEATS), real={"safety"}, camera=_CAMERA)
            acted.publish_route()
            with every(0.1, lambda: acted.tick(frames=True)):
                found = {"no console": _measured(robot, None, port, 0)}
                console = psutil.Process(robot.start("console").pid)
                time.sleep(_SETTLE_S)
                found["nobody looks"] = _measured(robot, console, port, 0)
                found["1 browser"] = _measured(robot, console, port, 1)
                found[f"{_BROWSERS} browsers"] = _measured(robot, console, port, _BROWSERS)
    rows = [[name, *(row.get(name, "") for row in found.values())] for name in found[f"{_BROWSERS} browsers"]]
    show(f"the web console at {_VERTICES * (_REPEATS + 1):,} vertices", ["", *found], rows)


def _measured(robot: Robot, console: psutil.Process | None, port: int, count: int) -> dict[str, float | str]:
    """The figures of one situation by their names."""
    browsers = None
    if count:
        url = f"ws://127.0.0.1:{port}/ws/robot"
        command = [sys.executable, "-m", "bench._browsers", url, str(count), str(_SECONDS + _SETTLE_S)]
        browsers = subprocess.Popen(command, stdout=subprocess.PIPE, cwd=ROOT)  # noqa: S603, our own module
        time.sleep(_SETTLE_S)
    began, before = time.monotonic(), _seconds(console)
    periods = _periods(robot)
    share = 100.0 * (_seconds(console) - before) / (time.monotonic() - began)
    figures: dict[str, float | str] = {
        "console, % of a core": share if console is not None else "",
        "safety's period p50, ms": float(np.median(periods)),
        "safety's period p99, ms": float(np.percentile(periods, 99)),
    }
    if browsers is None:
        return figures
    seen = json.loads(browsers.communicate()[0])
    return figures | {
        "stamp to browser p50, ms": 1e3 * seen["p50"],
        "stamp to browser p99, ms": 1e3 * seen["p99"],
        "at first, kB": seen["first"] / 1e3,
        "then, kB/s each": seen["later"] / 1e3,
        "messages/s each": seen["messages"],
        "pictures/s each": seen["pictures"],
    }


def _seconds(console: psutil.Process | None) -> float:
    """Processor time of the console so far."""
    return 0.0 if console is None else float(sum(console.cpu_times()[:2]))


def _periods(robot: Robot) -> Array:
    """Milliseconds between safety's commands, by its own stamps."""
    tap = robot.bus("watcher").tap([(topics.SAFE, "")])
    time.sleep(_SECONDS - 1.0)
    stamps = []
    while (sample := tap.take()) is not None:
        stamps.append(sample.envelope.stamp)
    return np.diff(stamps) * 1e-6


if __name__ == "__main__":
    main()
