"""What the doctor hears on a running robot's bus: a topic that is missing or slow, a process that is gone."""

import json
import socket
import threading

import numpy as np
import pytest

from cli.__main__ import run
from cli.doctor import traffic
from cli.processes import ROBOT
from common import topics
from common.bus import Bus
from common.messages import (
    CameraModel,
    Health,
    Odometry,
    SafetyStatus,
    State,
    StateName,
    StereoFrame,
    VelocityCommand,
    WheelOdometry,
    covariance_of,
    now_ns,
)
from common.topics import FLEET
from tests.processes import Robot

CAMERA = CameraModel(width=64, height=48, fx=50, fy=50, cx=32, cy=24, baseline=0.1, T_vehicle_camera=np.eye(4))
IMAGE = np.zeros((48, 64), np.uint8)


def messages(stamp):
    """One message of each topic that a robot which stands still must have, and the name in its key."""
    return {
        topics.STEREO: StereoFrame(stamp=stamp, camera=CAMERA, left=IMAGE, right=IMAGE),
        topics.WHEEL_ODOMETRY: WheelOdometry(stamp=stamp, v=0.0, w=0.0),
        topics.ODOMETRY: Odometry(
            stamp=stamp, vertex=None, T_vertex_robot=np.eye(4), covariance=covariance_of([1e-4] * 6),
            twist=np.zeros(6), success=True, inliers=9,
        ),
        topics.STATE: State(stamp=stamp, name=StateName.IDLE, environment="default", since=stamp, reason=""),
        topics.SAFE: VelocityCommand(stamp=stamp, v=0.0, w=0.0),
        topics.SAFETY_STATUS: SafetyStatus(stamp=stamp, passing=False, scale=0.0, latched=False, reasons=[]),
    }  # fmt: skip


class Chorus:
    """Every process of a robot, present, each publishing what it owns at the topic's rate or at a share of it."""

    def __init__(self, robot):
        self.share = {}
        self.behind_s = 0.0
        self._stop = threading.Event()
        buses = {process.name: robot.act_as(process.name) for process in ROBOT if process.name != "router"}
        self.buses = buses
        self._threads = [threading.Thread(target=self._sing, args=(topic,)) for topic in messages(1)]
        self._threads.append(threading.Thread(target=self._fleet, args=(robot.endpoint,)))
        for thread in self._threads:
            thread.start()

    def _sing(self, topic):
        publisher = self.buses[topic.owners[0]].publisher(topic, "front")
        due = 0.0
        while not self._stop.wait(1.0 / topic.rate_hz):
            due += self.share.get(topic, 1.0)
            if due >= 1.0:
                due -= 1.0
                publisher.put(messages(now_ns())[topic])

    def _fleet(self, endpoint):
        """The server's health, as its router would hand it on."""
        with Bus(FLEET, "fleet", endpoint, shared_memory=False) as bus:
            publisher = bus.publisher(topics.HEALTH, "fleet")
            figures = {"pid": 1, "started": 1, "cpu": 0.0, "memory_mb": 1.0, "rates": {}, "dropped": {}, "stages": {}}
            while not self._stop.wait(0.2):
                publisher.put(Health(stamp=now_ns() - round(self.behind_s * 1e9), process="fleet", **figures))

    def close(self):
        self._stop.set()
        for thread in self._threads:
            thread.join()


@pytest.fixture(scope="module")
def chorus(tmp_path_factory):
    with (
        socket.create_server(("127.0.0.1", 0)) as page,
        Robot(
            tmp_path_factory.mktemp("robot"),
            f'fleet = "tcp/127.0.0.1:1"\n[console]\nport = {page.getsockname()[1]}\n',
        ) as robot,
    ):
        singing = Chorus(robot)
        singing.robot = robot
        yield singing
        singing.close()


@pytest.fixture
def wrong(chorus, monkeypatch, capsys):
    """What is not well, by check."""
    monkeypatch.setattr(traffic, "LISTEN_S", 1.5)

    def ask():
        run(["doctor", "--config", str(chorus.robot.config), "--json"])
        checks = json.loads(capsys.readouterr().out)["checks"]
        return {c["name"]: c for c in checks if c["verdict"] != "ok" and c["name"] not in {"clock", "resources"}}

    yield ask
    chorus.share.clear()
    chorus.behind_s = 0.0


def test_a_robot_that_is_up_and_well(wrong):
    assert wrong() == {}


@pytest.mark.parametrize(
    ("topic", "share", "verdict", "words"),
    [
        (topics.SAFE, 0.0, "fail", "nobody publishes command/safe (that is safety)"),
        (topics.STEREO, 0.3, "warn", "sensor/stereo/front comes at"),
    ],
    ids=["silent", "slow"],
)
def test_a_topic_that_nobody_publishes_or_that_is_too_slow(chorus, wrong, topic, share, verdict, words):
    chorus.share[topic] = share
    found = wrong()
    assert found.keys() == {"topics"}
    assert found["topics"]["verdict"] == verdict
    assert words in found["topics"]["text"]


def test_a_clock_that_is_off_against_the_server_s(chorus, wrong):
    chorus.behind_s = 30.0
    found = wrong()
    assert found.keys() == {"fleet's clock"}
    assert "ahead of" in found["fleet's clock"]["text"]


def test_a_process_that_is_gone(chorus, wrong):
    chorus.buses["planner"].close()
    found = wrong()
    assert found.keys() == {"processes"}
    assert found["processes"]["text"] == "not present: planner"
