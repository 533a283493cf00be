"""Messages as a ROS graph sends them, by ``rosbags``, and what of ours is told to it."""

import numpy as np

from common import geometry
from common.camera import StereoCamera
from common.ids import VertexId, new_map_id
from common.messages import Localization, Route
from services.sensors.ros2 import types
from tests.ros import STORE, header, info_fields, make

MS = 1_000_000
NOW = 1_700_000_000_000 * MS
CAMERA = StereoCamera(64, 48, 50.0, 50.0, 31.5, 23.5, 0.12)


def info(camera=CAMERA, *, right=False, **other):
    return make("sensor_msgs/msg/CameraInfo", *(info_fields(camera, right, NOW) | other).values())


def through_cdr(message):
    """What a message of rosbags becomes on its way."""
    return types.decode(message.__msgtype__, bytes(STORE.serialize_cdr(message, message.__msgtype__)))


def vector(x, y, z):
    return make("geometry_msgs/msg/Vector3", float(x), float(y), float(z))


def twist(v, w):
    return make("geometry_msgs/msg/Twist", vector(v, 0, 0), vector(0, 0, w))


def odometry(v=1.0, w=0.5, quaternion=(0.0, 0.0, 0.6, 0.8), stamp=NOW):
    pose = make(
        "geometry_msgs/msg/Pose",
        make("geometry_msgs/msg/Point", 1.0, 2.0, 0.0),
        make("geometry_msgs/msg/Quaternion", *quaternion),
    )
    return make(
        "nav_msgs/msg/Odometry",
        header(stamp_ns=stamp, frame="odom"),
        "base_link",
        make("geometry_msgs/msg/PoseWithCovariance", pose, np.zeros(36)),
        make("geometry_msgs/msg/TwistWithCovariance", twist(v, w), np.zeros(36)),
    )


def shaded(height=48, width=64, channels=3):
    shape = (height, width, channels) if channels > 1 else (height, width)
    return np.random.default_rng(1).integers(0, 255, shape, np.uint8)


def cloud(beams=16, columns=180, **other):
    azimuth, elevation = np.meshgrid(np.linspace(np.pi, -np.pi, columns, endpoint=False), np.linspace(0.2, -0.3, beams))
    points = np.zeros((beams, columns), [("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("intensity", "<f4")])
    points["x"], points["y"] = 5 * np.cos(elevation) * np.cos(azimuth), 5 * np.cos(elevation) * np.sin(azimuth)
    points["z"], points["intensity"] = 5 * np.sin(elevation), 7.0
    named = ("x", "y", "z", "intensity")
    made = [make("sensor_msgs/msg/PointField", name, 4 * i, 7, 1) for i, name in enumerate(named)]
    values = {
        "header": header(stamp_ns=NOW, frame="lidar"),
        "height": beams,
        "width": columns,
        "fields": made,
        "is_bigendian": False,
        "point_step": 16,
        "row_step": 16 * columns,
        "data": np.frombuffer(points.tobytes(), np.uint8),
        "is_dense": True,
    }
    return make("sensor_msgs/msg/PointCloud2", *(values | other).values())


def joy(axes=(0.5, -1.0), buttons=(0, 1, 0)):
    return make("sensor_msgs/msg/Joy", header(stamp_ns=NOW), np.array(axes, np.float32), np.array(buttons, np.int32))


def route():
    path = np.array([geometry.from_xy_yaw(0.0, 0.0, 0.0), geometry.from_xy_yaw(2.0, 1.0, 1.2)])
    vertices = [VertexId(new_map_id("r1", NOW), index) for index in range(2)]
    return Route(id="r", environment="e", goal="g", vertices=vertices, path=path, length=2.2, maps=[], reason="")


def localization(**other):
    values = {
        "stamp": NOW,
        "route": "r",
        "trunk": route().vertices[1],
        "trunk_index": 1,
        "T_trunk_robot": geometry.from_xy_yaw(0.3, 0.1, 0.05),
        "covariance": np.eye(6),
        "success": True,
        "stream": "plain",
        "inliers": 50,
        "metres_since_success": 0.0,
        "seconds_since_success": 0.0,
    }
    return Localization(**(values | other))
