"""A robot that is known to ROS alone is taught a route and repeats it: images in, ``cmd_vel`` out.

In the middle of the repeat the graph's router is killed: the base stops by itself, and goes on when it is back.
"""

import contextlib
import json
import subprocess
import sys

import numpy as np
import pytest

from cli import client
from cli.demo.errors import path_errors
from cli.processes import ROBOT
from cli.supervision.supervised import Supervised
from common import config, geometry, topics
from common.ids import VertexId
from common.messages import GraphQuery
from tests.commands import command
from tests.processes import ROOT, eventually, free_port
from tests.ros import Router

SHORT_M = 15.0
BESIDE_M = 0.2


class RosSide:
    """The process of the ROS graph."""

    def __init__(self, port, folder):
        self._process = subprocess.Popen(
            [sys.executable, "-m", "tests.integration.ros_robot", str(port), str(folder)],
            cwd=ROOT,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )

    def __enter__(self):
        return self

    def __exit__(self, *_error):
        self._process.kill()
        self._process.wait()

    def ready(self):
        assert json.loads(self._process.stdout.readline())["ready"]

    def ask(self, *request):
        self._process.stdin.write(json.dumps(request) + "\n")
        self._process.stdin.flush()
        return json.loads(self._process.stdout.readline())

    def trace(self):
        """Where it truly drove, (N, 4, 4)."""
        return np.array([geometry.from_xy_yaw(*pose) for pose in self.ask("trace")["driven"]])


@pytest.fixture
def robot(tmp_path):
    with Router() as router, contextlib.ExitStack() as stack:
        path = tmp_path / "robot.toml"
        path.write_text(
            f'[robot]\nname = "r1"\ndirectory = "{tmp_path}"\nenvironment = "garden"\n'
            f'[bus]\nendpoint = "tcp/127.0.0.1:{free_port()}"\n'
            '[sensors]\ndriver = "ros2"\n'
            "[sensors.cameras]\nwavelengths = [610e-9, 540e-9, 460e-9]\n"
            f'[sensors.ros2]\nendpoint = "{router.endpoint}"\n'
            '[sensors.ros2.inputs]\nleft = "left/image_rect"\nright = "right/image_rect"\nteleop = "teleop"\n'
        )
        ros = stack.enter_context(RosSide(router.port, tmp_path / "definitions"))
        supervised = Supervised(path, [process for process in ROBOT if process.name != "console"])
        supervised.start()
        stack.callback(supervised.stop)
        supervised.wait_ready()
        ros.ready()
        bus = stack.enter_context(client.connect(config.load(path)))
        yield ros, bus, router


def test_a_ros_graph_drives_a_teach_and_a_repeat(robot):
    ros, bus, router = robot
    odometry, states = bus.subscribe(topics.ODOMETRY), bus.subscribe(topics.STATE)
    eventually(lambda: (last := odometry.last()) and last.message.success, "the estimator sees", 60.0)
    start = ros.ask("state")["route"]

    ros.ask("place", *start)
    eventually(lambda: (last := states.last()) and last.message.name == "Idle", "idle")
    bus.ask(topics.MISSION, command("teach", start_place="start"), timeout=10.0)
    ros.ask("drive", SHORT_M)
    eventually(lambda: ros.ask("state")["arrived"] and ros.ask("state")["speed"] < 0.01, "the person arrives", 40.0)
    bus.ask(topics.MISSION, command("finish", end_place="end"), timeout=30.0)
    taught = ros.trace()
    driven = np.linalg.norm(np.diff(taught[:, :2, 3], axis=0), axis=1).sum()
    assert driven > SHORT_M - 1.0
    assert ros.ask("state")["metres_seen"] == pytest.approx(driven, rel=0.1)

    x, y, yaw = start
    ros.ask("place", x - BESIDE_M * np.sin(yaw), y + BESIDE_M * np.cos(yaw), yaw + 0.05)
    map_id = bus.ask(topics.MAPS, GraphQuery(environment="garden")).maps[-1].record.id
    bus.ask(topics.MISSION, command("repeat", goal="end", vertex=VertexId(map_id, 0)), timeout=60.0)
    eventually(lambda: ros.ask("state")["speed"] > 0.5, "it drives", 20.0)
    router.restart()
    eventually(lambda: ros.ask("state")["speed"] < 0.01, "it stands while the graph is apart", 5.0)
    eventually(lambda: ros.ask("state")["speed"] > 0.5, "it drives on", 30.0)
    eventually(lambda: states.last().message.name in ("Idle", "Paused"), "the repeat ends", 40.0)
    assert states.last().message.reason.startswith("reached"), states.last().message.reason
    repeated = ros.trace()
    settled = np.abs(path_errors(taught, repeated).after(5.0).lateral)
    assert np.sqrt(np.mean(settled**2)) <= 0.05
    assert settled.max() <= 0.2
    assert np.linalg.norm(repeated[-1][:2, 3] - taught[-1][:2, 3]) <= 0.15
    told = ros.ask("state")["on_route"]
    truly = geometry.inverse(taught[0]) @ repeated[-1]
    assert np.linalg.norm(np.array(told) - truly[:2, 3]) <= 0.2
