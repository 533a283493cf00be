"""Bags of both ROSes, written by rosbags."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from mcap.writer import Writer as McapWriter
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

TF = "tf2_msgs/msg/TFMessage"
KINDS = ("ros1", "sqlite3", "mcap", "ros1 in mcap")
MS = 1_000_000
START = 1_700_000_000_000 * MS
FRAMES = 5
SIZE = (48, 64)
FX, BASELINE = 50.0, 0.12


class Converted:
    """ROS 1's messages in MCAP, as ``mcap convert`` writes them."""

    def __init__(self, path):
        self._path = path

    def open(self):
        self._stream = self._path.open("wb")
        self._writer = McapWriter(self._stream)
        self._writer.start(profile="ros1", library="mcap convert")

    def close(self):
        self._writer.finish()
        self._stream.close()

    def add_connection(self, topic, name, typestore):
        text, _ = typestore.generate_msgdef(name, ros_version=1)
        kind = name.replace("/msg/", "/")
        schema = self._writer.register_schema(name=kind, encoding="ros1msg", data=text.encode())
        return self._writer.register_channel(topic=topic, message_encoding="ros1", schema_id=schema)

    def write(self, channel, time, data):
        self._writer.add_message(channel, log_time=time, publish_time=time, data=bytes(data))


@dataclass
class Bag:
    """A bag that is being written."""

    kind: str
    path: Path

    def __post_init__(self):
        self.ros1 = self.kind.startswith("ros1")
        self.store = get_typestore(Stores.ROS1_NOETIC if self.ros1 else Stores.ROS2_HUMBLE)
        if self.ros1:
            self.store.register(get_types_from_msg("geometry_msgs/TransformStamped[] transforms", TF))
        self.t = self.store.types
        self._connections = {}

    def __enter__(self):
        if self.kind == "ros1":
            self._writer = Writer1(self.path)
        elif self.ros1:
            self._writer = Converted(self.path)
        else:
            plugin = StoragePlugin.MCAP if self.kind == "mcap" else StoragePlugin.SQLITE3
            self._writer = Writer2(self.path, version=9, storage_plugin=plugin)
        self._writer.open()
        return self

    def __exit__(self, *_):
        self._writer.close()

    def put(self, topic, message, time):
        name = message.__msgtype__
        if topic not in self._connections:
            self._connections[topic] = self._writer.add_connection(topic, name, typestore=self.store)
        serialize = self.store.serialize_ros1 if self.ros1 else self.store.serialize_cdr
        self._writer.write(self._connections[topic], time, serialize(message, name))

    def header(self, stamp, frame="camera"):
        time = self.t["builtin_interfaces/msg/Time"](sec=stamp // 10**9, nanosec=stamp % 10**9)
        more = {"seq": 0} if self.ros1 else {}
        return self.t["std_msgs/msg/Header"](stamp=time, frame_id=frame, **more)

    def image(self, stamp, pixels, encoding="mono8"):
        height, width = pixels.shape[:2]
        return self.t["sensor_msgs/msg/Image"](
            header=self.header(stamp),
            height=height,
            width=width,
            encoding=encoding,
            is_bigendian=0,
            step=pixels.strides[0],
            data=np.frombuffer(pixels.tobytes(), np.uint8),
        )

    def info(self, stamp, *, right=False, D=(0.0,) * 5, frame="camera", fx=FX):
        K = np.array([fx, 0, 31.5, 0, fx, 23.5, 0, 0, 1.0])
        P = np.array([fx, 0, 31.5, -fx * BASELINE if right else 0.0, 0, fx, 23.5, 0, 0, 0, 1.0, 0])
        names = "DKRP" if self.ros1 else "dkrp"
        matrices = dict(zip(names, (np.array(D), K, np.eye(3).ravel(), P), strict=True))
        roi = self.t["sensor_msgs/msg/RegionOfInterest"](x_offset=0, y_offset=0, height=0, width=0, do_rectify=False)
        return self.t["sensor_msgs/msg/CameraInfo"](
            header=self.header(stamp, frame),
            height=SIZE[0],
            width=SIZE[1],
            distortion_model="plumb_bob",
            binning_x=0,
            binning_y=0,
            roi=roi,
            **matrices,
        )

    def odometry(self, stamp, v, w):
        t = self.t
        zero = t["geometry_msgs/msg/Vector3"](x=0.0, y=0.0, z=0.0)
        pose = t["geometry_msgs/msg/Pose"](
            position=t["geometry_msgs/msg/Point"](x=0.0, y=0.0, z=0.0),
            orientation=t["geometry_msgs/msg/Quaternion"](x=0.0, y=0.0, z=0.0, w=1.0),
        )
        twist = t["geometry_msgs/msg/Twist"](
            linear=t["geometry_msgs/msg/Vector3"](x=v, y=0.0, z=0.0),
            angular=t["geometry_msgs/msg/Vector3"](x=zero.x, y=0.0, z=w),
        )
        covariance = np.zeros(36)
        return t["nav_msgs/msg/Odometry"](
            header=self.header(stamp, "odom"),
            child_frame_id="base_link",
            pose=t["geometry_msgs/msg/PoseWithCovariance"](pose=pose, covariance=covariance),
            twist=t["geometry_msgs/msg/TwistWithCovariance"](twist=twist, covariance=covariance),
        )

    def joy(self, stamp, axes, buttons):
        return self.t["sensor_msgs/msg/Joy"](
            header=self.header(stamp), axes=np.array(axes, np.float32), buttons=np.array(buttons, np.int32)
        )

    def cloud(self, stamp, fields, points, height=1):
        """``points`` is a structured array."""
        t = self.t["sensor_msgs/msg/PointField"]
        types = {"float32": 7, "uint16": 4, "uint32": 6, "uint8": 2, "float64": 8}
        layout = [
            t(name=name, offset=points.dtype.fields[name][1], datatype=types[str(points.dtype[name])], count=1)
            for name in fields
        ]
        width = points.size // height
        return self.t["sensor_msgs/msg/PointCloud2"](
            header=self.header(stamp, "velodyne"),
            height=height,
            width=width,
            fields=layout,
            is_bigendian=False,
            point_step=points.itemsize,
            row_step=points.itemsize * width,
            data=np.frombuffer(points.tobytes(), np.uint8),
            is_dense=True,
        )

    def static(self, frame, translation):
        t = self.t
        moved = t["geometry_msgs/msg/Transform"](
            translation=t["geometry_msgs/msg/Vector3"](*translation),
            rotation=t["geometry_msgs/msg/Quaternion"](x=-0.5, y=0.5, z=-0.5, w=0.5),
        )
        stamped = t["geometry_msgs/msg/TransformStamped"](
            header=self.header(START, "base_link"), child_frame_id=frame, transform=moved
        )
        return t[TF](transforms=[stamped])


def pixels(number, side=0):
    return np.random.default_rng(100 * number + side).integers(0, 255, SIZE, np.uint8)


def at(number):
    return START + number * 100 * MS
