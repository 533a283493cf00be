"""A robot of which only ROS knows: the synthetic world behind nodes of ``zenoh-ros2-sdk``, as a process of its own.

It publishes stereo images with their camera infos, wheel odometry and static transforms, obeys ``/cmd_vel`` alone,
listens to what it is told of its way, and has a person at the joystick, who publishes ``/teleop``. A line of standard
input is a command in JSON; each is answered by a line of standard output.
"""

from __future__ import annotations

import json
import sys
import threading
import time
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cli.demo.driver import Driver, DriverSettings
from common import geometry
from services.sensors.world import World
from tests.ros import Nodes, image_fields, info_fields

BASE_HZ, CAMERA_HZ, PERSON_HZ = 50.0, 10.0, 20.0
CAMERA_FRAME = "left_optical"


def main() -> None:
    """Runs until its input ends: ``ros_robot PORT FOLDER``."""
    with Nodes(int(sys.argv[1]), Path(sys.argv[2])) as nodes:
        robot = RosRobot(nodes)
        robot.start()
        _answer({"ready": True})
        for line in sys.stdin:
            _answer(robot.obey(*json.loads(line)))
        robot.stop.set()


def _answer(content: dict[str, object]) -> None:
    sys.stdout.write(json.dumps(content) + "\n")
    sys.stdout.flush()


class RosRobot:
    """The world, a thread for each of its nodes, and what it has driven."""

    def __init__(self, nodes: Nodes) -> None:
        self.stop = threading.Event()
        self._nodes = nodes
        self._world = World()
        self._world.warm_up(lidar=False)
        self._lock = threading.Lock()
        self._command: tuple[float, float] | None = None
        self._commands = 0
        self._driven: list[list[float]] = []
        self._odometry: NDArray[np.float64] = np.eye(4)
        self._driver: Driver | None = None
        self._seen: list[NDArray[np.float64]] = []
        self._T_route_odom: NDArray[np.float64] | None = None

    def start(self) -> None:
        """Joins the graph."""
        self._nodes.subscribe("/cmd_vel", "geometry_msgs/msg/Twist", self._take)
        self._nodes.subscribe("/vtr/odometry", "nav_msgs/msg/Odometry", self._see_itself)
        self._nodes.subscribe("/tf", "tf2_msgs/msg/TFMessage", self._be_placed)
        for run in (self._drive, self._see, self._person):
            threading.Thread(target=run, daemon=True).start()

    def obey(self, action: str, *values: float) -> dict[str, object]:
        """What an operator or a test asks for."""
        with self._lock:
            if action == "place":
                self._world.place(*values)
                self._driven.clear()
                self._seen.clear()
            if action == "drive":
                route, steps = self._world.scene.demo_route(), 0.1
                self._driver = Driver(route[: int(values[0] / steps)], DriverSettings(speed=1.1, acceleration=1.0))
            state, T = self._world.base_state, self._T_route_odom
            return {
                "route": self._world.scene.demo_route()[0].tolist(),
                "arrived": self._driver is None,
                "speed": abs(state.wheel_v),
                "driven": self._driven if action == "trace" else len(self._driven),
                "commands": self._commands,
                "metres_seen": float(np.linalg.norm(np.diff(self._seen, axis=0), axis=1).sum()) if self._seen else 0.0,
                "on_route": None if T is None else (T @ self._odometry)[:2, 3].tolist(),
            }

    def _take(self, twist) -> None:
        self._command = (twist.linear.x, twist.angular.z)
        self._commands += 1

    def _see_itself(self, odometry) -> None:
        position = odometry.pose.pose.position
        self._seen.append(np.array([position.x, position.y, position.z]))

    def _be_placed(self, message) -> None:
        made = message.transforms[0]
        assert (made.header.frame_id, made.child_frame_id) == ("vtr_route", "odom")
        t, q = made.transform.translation, made.transform.rotation
        axis, sine = np.array([q.x, q.y, q.z]), float(np.linalg.norm([q.x, q.y, q.z]))
        turn = geometry.so3_exp(2.0 * np.arctan2(sine, q.w) * axis / max(sine, 1e-12))
        self._T_route_odom = geometry.transform(turn, [t.x, t.y, t.z])

    def _due(self, rate: float):
        due = time.monotonic()
        while not self.stop.is_set():
            due = max(due + 1.0 / rate, time.monotonic())
            self.stop.wait(due - time.monotonic())
            yield

    def _drive(self) -> None:
        publisher = self._nodes.publisher("/odom", "nav_msgs/msg/Odometry")
        last = time.monotonic()
        for _ in self._due(BASE_HZ):
            now = time.monotonic()
            with self._lock:
                command, self._command = self._command, None
                self._world.step(now - last, command)
                v, w = self._world.wheel_odometry()
                state = self._world.base_state
                if state.wheel_v:
                    self._driven.append([state.x, state.y, state.yaw])
            self._odometry = self._odometry @ geometry.exp([v * (now - last), 0, 0, 0, 0, w * (now - last)])
            last = now
            publisher.publish(**self._odometry_fields(v, w))

    def _odometry_fields(self, v: float, w: float) -> dict[str, object]:
        make, yaw = self._nodes.make, float(geometry.yaw_of(self._odometry))
        point = make("geometry_msgs/msg/Point", *map(float, self._odometry[:3, 3]))
        turn = make("geometry_msgs/msg/Quaternion", 0.0, 0.0, float(np.sin(yaw / 2)), float(np.cos(yaw / 2)))
        linear, angular = (make("geometry_msgs/msg/Vector3", *xyz) for xyz in ((v, 0.0, 0.0), (0.0, 0.0, w)))
        pose, twist = make("geometry_msgs/msg/Pose", point, turn), make("geometry_msgs/msg/Twist", linear, angular)
        return {
            "header": self._nodes.header(frame="odom"),
            "child_frame_id": "base_link",
            "pose": make("geometry_msgs/msg/PoseWithCovariance", pose, np.zeros(36)),
            "twist": make("geometry_msgs/msg/TwistWithCovariance", twist, np.zeros(36)),
        }

    def _see(self) -> None:
        images = [self._nodes.publisher(f"/{side}/image_rect", "sensor_msgs/msg/Image") for side in ("left", "right")]
        infos = [
            self._nodes.publisher(f"/{side}/camera_info", "sensor_msgs/msg/CameraInfo") for side in ("left", "right")
        ]
        static = self._nodes.publisher("/tf_static", "tf2_msgs/msg/TFMessage")
        for number, _ in enumerate(self._due(CAMERA_HZ)):
            stamp = time.time_ns()
            for right, pixels in enumerate(self._world.render()):
                images[right].publish(**image_fields(pixels, stamp, "rgb8", CAMERA_FRAME, self._nodes.make))
                infos[right].publish(
                    **info_fields(self._world.camera, bool(right), stamp, CAMERA_FRAME, self._nodes.make)
                )
            # The SDK's publishers keep nothing for who comes later.
            if number % int(CAMERA_HZ) == 0:
                static.publish(transforms=[self._mounting()])

    def _mounting(self):
        make, T = self._nodes.make, self._world.camera.T_vehicle_camera
        axis = geometry.so3_log(T[:3, :3])
        half = float(np.linalg.norm(axis)) / 2.0
        x, y, z = axis * np.sin(half) / (2.0 * half)
        where = make("geometry_msgs/msg/Vector3", *map(float, T[:3, 3]))
        turn = make("geometry_msgs/msg/Quaternion", float(x), float(y), float(z), float(np.cos(half)))
        body = make("geometry_msgs/msg/Transform", where, turn)
        return make("geometry_msgs/msg/TransformStamped", self._nodes.header(), CAMERA_FRAME, body)

    def _person(self) -> None:
        publisher = self._nodes.publisher("/teleop", "geometry_msgs/msg/Twist")
        for _ in self._due(PERSON_HZ):
            with self._lock:
                driver, pose = self._driver, self._world.T_world_vehicle
                command = None if driver is None else driver.command(pose, 1.0 / PERSON_HZ)
                if command is None:
                    self._driver = None
            v, w = command or (0.0, 0.0)
            vector = "geometry_msgs/msg/Vector3"
            linear, angular = self._nodes.make(vector, v, 0.0, 0.0), self._nodes.make(vector, 0.0, 0.0, w)
            if driver is not None:
                publisher.publish(linear=linear, angular=angular)


if __name__ == "__main__":
    main()
