"""A ROS 2 graph beside the robot: a Zenoh router as ``rmw_zenohd`` is, and nodes by ``zenoh-ros2-sdk``.

The SDK shares none of the driver's code for keys, tokens, hashes and attachments. It reads definitions of messages from
a folder, and would clone them from GitHub: ``write_definitions`` has those of ``rosbags``, as ROS's own ``.msg`` files.
"""

from __future__ import annotations

import re
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.typesys import Stores, get_typestore
from zenoh_ros2_sdk import ROS2Publisher, ROS2Subscriber, message_registry
from zenoh_ros2_sdk.discovery import get_topic_info, get_topic_names_and_types
from zenoh_ros2_sdk.session import ZenohSession

from tests.processes import free_port

STORE = get_typestore(Stores.ROS2_JAZZY)

ROOTS = (
    "sensor_msgs/msg/Image",
    "sensor_msgs/msg/CompressedImage",
    "sensor_msgs/msg/CameraInfo",
    "sensor_msgs/msg/PointCloud2",
    "sensor_msgs/msg/Joy",
    "nav_msgs/msg/Odometry",
    "nav_msgs/msg/Path",
    "geometry_msgs/msg/Twist",
    "geometry_msgs/msg/TwistStamped",
    "tf2_msgs/msg/TFMessage",
    "std_msgs/msg/String",
)

_ROUTER = """
import json, sys, threading, zenoh
config = zenoh.Config()
for key, value in {
    "mode": "router", "listen/endpoints": [sys.argv[1]], "scouting/multicast/enabled": False,
    "scouting/gossip/enabled": True,
}.items():
    config.insert_json5(key, json.dumps(value))
with zenoh.open(config):
    print("up", flush=True)
    threading.Event().wait()
"""


class Router:
    """The router of a ROS graph, as a process; killed at the end of the block."""

    def __init__(self) -> None:
        self.port = free_port()
        self.endpoint = f"tcp/127.0.0.1:{self.port}"

    def __enter__(self):
        self._start()
        return self

    def __exit__(self, *_error):
        self.kill()

    def _start(self):
        command = [sys.executable, "-c", _ROUTER, self.endpoint]
        self._process = subprocess.Popen(command, stdout=subprocess.PIPE)
        assert self._process.stdout.readline() == b"up\n"

    def kill(self):
        """As ``kill -9`` does."""
        self._process.kill()
        self._process.wait()
        self._process.stdout.close()

    def restart(self):
        """Kills it and starts another at the same address."""
        self.kill()
        self._start()


def write_definitions(folder: Path) -> None:
    """The ``.msg`` files of :data:`ROOTS` and all that they need."""
    for root in ROOTS:
        text = STORE.generate_msgdef(root, ros_version=2)[0]
        first, *others = re.split(r"^=+\nMSG: ", text, flags=re.MULTILINE)
        _write(folder, root, first)
        for other in others:
            name, _, body = other.partition("\n")
            _write(folder, name.replace("/", "/msg/") if "/msg/" not in name else name, body)


def _write(folder: Path, name: str, body: str) -> None:
    file = folder / f"{name}.msg"
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(body, encoding="utf-8")


class Nodes:
    """Nodes of the graph, by ``zenoh-ros2-sdk``; one in a process, for the SDK has one session."""

    def __init__(self, port: int, definitions: Path, domain: int = 0) -> None:
        write_definitions(definitions)
        message_registry._registry = None
        message_registry.get_registry(str(definitions))
        self._at = {"router_ip": "127.0.0.1", "router_port": port}
        self._domain = domain
        self.session = ZenohSession.get_instance(**self._at)
        self._open: list[Any] = []

    def __enter__(self):
        return self

    def __exit__(self, *_error):
        for made in self._open:
            made.close()
        self.session.close()

    def publisher(self, topic, type_name, **options):
        """A publisher of the SDK."""
        made = ROS2Publisher(topic, type_name, domain_id=self._domain, **self._at, **options)
        self._open.append(made)
        return made

    def subscribe(self, topic, type_name, receive, **options):
        """A subscription of the SDK."""
        made = ROS2Subscriber(topic, type_name, receive, domain_id=self._domain, **self._at, **options)
        self._open.append(made)
        return made

    def topics(self):
        """As ``ros2 topic list -t``: types by topic."""
        return dict(get_topic_names_and_types(self._domain, **self._at))

    def info(self, topic):
        """As ``ros2 topic info -v``."""
        return get_topic_info(topic, self._domain, **self._at, verbose=True)

    def make(self, type_name, *values):
        """A message of the SDK's own classes."""
        return self.session.register_message_type(None, type_name)(*values)

    def header(self, stamp_ns=None, frame="base_link"):
        """A header, of now where no stamp is given."""
        return header(self.make, stamp_ns, frame)


def make(type_name: str, *values: Any) -> Any:
    """A message by ``rosbags``."""
    return STORE.types[type_name](*values)


def header(make_message: Any = make, stamp_ns: int | None = None, frame: str = "base_link") -> Any:
    """A ``std_msgs/Header``, of now where no stamp is given."""
    sec, nanosec = divmod(time.time_ns() if stamp_ns is None else stamp_ns, 1_000_000_000)
    return make_message("std_msgs/msg/Header", make_message("builtin_interfaces/msg/Time", sec, nanosec), frame)


def image(pixels: np.ndarray, stamp_ns: int, encoding: str, frame: str = "left", make_message: Any = make) -> Any:
    """A ``sensor_msgs/Image``."""
    _height, _width = pixels.shape[:2]
    return make_message(
        "sensor_msgs/msg/Image", *image_fields(pixels, stamp_ns, encoding, frame, make_message).values()
    )


def image_fields(pixels, stamp_ns, encoding, frame="left", make_message=make):
    """The fields of an image, by name."""
    height, width = pixels.shape[:2]
    return {
        "header": header(make_message, stamp_ns, frame),
        "height": height,
        "width": width,
        "encoding": encoding,
        "is_bigendian": 0,
        "step": pixels.strides[0],
        "data": np.ascontiguousarray(pixels).reshape(-1),
    }


def info_fields(camera, right, stamp_ns, frame="left", make_message=make):
    """The fields of a rectified camera's info; ``right`` says which side it is of."""
    f, g, cx, cy = camera.fx, camera.fy, camera.cx, camera.cy
    K = np.array([f, 0, cx, 0, g, cy, 0, 0, 1.0])
    P = np.array([f, 0, cx, -f * camera.baseline if right else 0.0, 0, g, cy, 0, 0, 0, 1, 0.0])
    roi = make_message("sensor_msgs/msg/RegionOfInterest", 0, 0, 0, 0, False)
    return {
        "header": header(make_message, stamp_ns, frame),
        "height": camera.height,
        "width": camera.width,
        "distortion_model": "plumb_bob",
        "d": np.zeros(5),
        "k": K,
        "r": np.eye(3).reshape(-1),
        "p": P,
        "binning_x": 0,
        "binning_y": 0,
        "roi": roi,
    }
