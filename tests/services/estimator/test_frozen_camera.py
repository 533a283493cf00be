"""The estimator as a process whose camera hangs: what it shows stands still while the wheels turn."""

import cv2
import numpy as np
import pytest

from common import topics
from common.camera import StereoCamera
from common.messages import CameraModel, StereoFrame, WheelOdometry, now_ns
from tests.processes import Robot, eventually, every

WIDTH, HEIGHT, DISPARITY = 640, 400, 24
CAMERA = CameraModel.of(
    StereoCamera(WIDTH, HEIGHT, 425.0, 425.0, 319.5, 199.5, 0.24, T_vehicle_camera=np.array(
        [[0.0, 0.0, 1.0, 0.2], [-1.0, 0.0, 0.0, 0.0], [0.0, -1.0, 0.0, 0.4], [0.0, 0.0, 0.0, 1.0]]
    ))
)  # fmt: skip
RNG = np.random.default_rng(3)
BLOCK = 16
BLOCKS = RNG.integers(20, 235, (HEIGHT // BLOCK, (WIDTH + DISPARITY) // BLOCK + 1), np.uint8)
WALL = cv2.resize(BLOCKS, None, fx=BLOCK, fy=BLOCK, interpolation=cv2.INTER_NEAREST)[:, : WIDTH + DISPARITY]
WALL = cv2.GaussianBlur(WALL, (0, 0), 1.0)


class Vehicle:
    """Says what a robot before a wall sees, and what its wheels do."""

    def __init__(self, robot):
        sensors = robot.act_as("sensors")
        self._frames = sensors.publisher(topics.STEREO, name="front")
        self._wheels = robot.bus("base").publisher(topics.WHEEL_ODOMETRY)
        self._images = self._noisy()
        self.speed, self.hangs = 0.0, False

    def _noisy(self):
        wall = np.clip(WALL + RNG.normal(0.0, 1.5, WALL.shape), 0, 255).astype(np.uint8)
        return wall[:, DISPARITY:].copy(), wall[:, :WIDTH].copy()

    def look(self):
        if not self.hangs:
            self._images = self._noisy()
        left, right = self._images
        self._frames.put(StereoFrame(stamp=now_ns(), camera=CAMERA, left=left, right=right))

    def turn_wheels(self):
        self._wheels.put(WheelOdometry(stamp=now_ns(), v=self.speed, w=0.0))


@pytest.fixture
def robot(tmp_path):
    with Robot(tmp_path) as robot:
        yield robot


def test_wheels_are_believed_while_the_camera_hangs(robot):
    vehicle = Vehicle(robot)
    odometry = robot.bus("operator").subscribe(topics.ODOMETRY)

    def told(holds, what):
        return eventually(lambda: (m := odometry.last()) and holds(m.message) and m.message, what)

    with every(0.02, vehicle.turn_wheels), every(0.1, vehicle.look):
        robot.start("estimator")
        told(lambda m: m.success and m.inliers > 50 and abs(m.twist[0]) < 0.1, "a wall stands still")
        vehicle.hangs, vehicle.speed = True, 0.5
        hung = told(lambda m: m.reason == "the sensor repeats its last frame", "the camera hangs")
        assert not hung.success
        told(lambda m: m.twist[0] == pytest.approx(0.5, abs=0.05), "the wheels are believed")
        vehicle.speed = 0.0
        told(lambda m: abs(m.twist[0]) < 0.05, "the robot stands")
        assert not told(lambda m: m.reason, "the camera still hangs").success
        vehicle.hangs = False
        assert told(lambda m: m.success and m.inliers > 50, "the camera shows something new").reason == ""
