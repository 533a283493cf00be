"""ROS's messages that are exchanged: their names, their hashes (REP-2016), and CDR by ``rosbags``.

A large field, such as an image's pixels, is a view of the bytes that were given.
"""

from __future__ import annotations

import struct
from functools import cache
from typing import Any

from rosbags.serde import SerdeError
from rosbags.typesys import Stores, get_typestore
from rosbags.typesys.store import Typestore

from services.sensors.ros2.errors import RosDataError
from services.sensors.ros2.settings import Distro

IMAGE = "sensor_msgs/msg/Image"
COMPRESSED = "sensor_msgs/msg/CompressedImage"
CAMERA_INFO = "sensor_msgs/msg/CameraInfo"
POINTS = "sensor_msgs/msg/PointCloud2"
JOY = "sensor_msgs/msg/Joy"
ODOMETRY = "nav_msgs/msg/Odometry"
PATH = "nav_msgs/msg/Path"
POSE_STAMPED = "geometry_msgs/msg/PoseStamped"
TWIST = "geometry_msgs/msg/Twist"
TWIST_STAMPED = "geometry_msgs/msg/TwistStamped"
TRANSFORMS = "tf2_msgs/msg/TFMessage"

_LARGE = frozenset({IMAGE, COMPRESSED, POINTS})
_LARGEST, _LARGEST_OF_OTHERS = 128_000_000, 1_000_000
"""Bytes; a sample that is larger is not looked at."""

_NO_HASH = "TypeHashNotSupported"


@cache
def store() -> Typestore:
    """The definitions of all types; those above are the same from Humble to Lyrical, and so are their hashes."""
    return get_typestore(Stores.ROS2_JAZZY)


@cache
def hash_of(type_name: str, distro: Distro) -> str:
    """The hash of a type as it stands in keys; Humble has none."""
    return _NO_HASH if distro == "humble" else store().hash_rihs01(type_name)


def make(type_name: str, *values: Any) -> Any:  # noqa: ANN401, classes that rosbags makes at run time
    """A message of a type, of its fields in order."""
    return store().types[type_name](*values)


def encode(message: Any) -> bytes:  # noqa: ANN401
    """The CDR of a message, with its encapsulation header."""
    return bytes(store().serialize_cdr(message, message.__msgtype__))


def decode(type_name: str, data: bytes) -> Any:  # noqa: ANN401
    """The message of a type in CDR, little- or big-endian, with its encapsulation header.

    Raises:
        RosDataError: the bytes are no such message, or too many.
    """
    limit = _LARGEST if type_name in _LARGE else _LARGEST_OF_OTHERS
    if len(data) > limit:
        raise RosDataError(f"{len(data) / 1e6:.1f} MB are too much for a {type_name}: at most {limit / 1e6:g} MB")
    try:
        return store().deserialize_cdr(memoryview(data), type_name)
    except (SerdeError, struct.error, ValueError, IndexError, OverflowError, MemoryError) as error:
        raise RosDataError(f"not the CDR of a {type_name}: {' '.join(str(error).split())[:150]}") from None


def stamp_of(header: Any) -> int:  # noqa: ANN401
    """A header's stamp, nanoseconds since the epoch; 0 where its sender has set none.

    Raises:
        RosDataError: it is no time.
    """
    sec, nanosec = int(header.stamp.sec), int(header.stamp.nanosec)
    if sec < 0 or nanosec >= 1_000_000_000:
        raise RosDataError(f"the stamp {sec} s {nanosec} ns is no time")
    return sec * 1_000_000_000 + nanosec


def header(stamp_ns: int, frame: str) -> Any:  # noqa: ANN401
    """A ``std_msgs/Header``."""
    sec, nanosec = divmod(stamp_ns, 1_000_000_000)
    return make("std_msgs/msg/Header", make("builtin_interfaces/msg/Time", sec, nanosec), frame)
