"""Our messages as ROS's."""

from __future__ import annotations

import threading
from collections import deque
from typing import Any

import numpy as np

from common import geometry
from common.geometry import Array
from common.messages import Localization, Odometry, Route
from services.sensors.ros2 import types
from services.sensors.ros2.types import header, make

_MEMORY = 512
_LONGEST_STEP_S = 1.0
_NEAR_NS = 200_000_000


def twist(v: float, w: float) -> Any:  # noqa: ANN401, classes that rosbags makes at run time
    """A ``geometry_msgs/Twist`` of a speed forward, m/s, and a turn rate, rad/s."""
    return _twist(np.array([v, 0.0, 0.0, 0.0, 0.0, w]))


def twist_stamped(v: float, w: float, stamp_ns: int, frame: str) -> Any:  # noqa: ANN401
    """A ``geometry_msgs/TwistStamped``."""
    return make(types.TWIST_STAMPED, header(stamp_ns, frame), twist(v, w))


def path(route: Route, frame: str, stamp_ns: int) -> Any:  # noqa: ANN401
    """The ``nav_msgs/Path`` of a route, in the frame of its first vertex."""
    head = header(stamp_ns, frame)
    poses = [make(types.POSE_STAMPED, head, _pose(T)) for T in route.path]
    return make(types.PATH, head, poses)


def transform(T_parent_child: Array, stamp_ns: int, parent: str, child: str) -> Any:  # noqa: ANN401
    """A ``tf2_msgs/TFMessage`` of one transform."""
    t, q = _vector(T_parent_child[:3, 3]), _quaternion(T_parent_child)
    body = make("geometry_msgs/msg/Transform", t, q)
    return make(types.TRANSFORMS, [make("geometry_msgs/msg/TransformStamped", header(stamp_ns, parent), child, body)])


class VisualOdometry:
    """``nav_msgs/Odometry`` by the robot's eyes: the twist of each frame, summed up from where the driver began."""

    def __init__(self, frame: str, base: str) -> None:
        self._frame, self._base = frame, base
        self._T = np.eye(4)
        self._stamp: int | None = None

    def message(self, odometry: Odometry) -> Any:  # noqa: ANN401
        """The message after a frame; its covariance is of the twist alone, and not known."""
        seconds = 0.0 if self._stamp is None else (odometry.stamp - self._stamp) * 1e-9
        if 0.0 < seconds <= _LONGEST_STEP_S:
            self._T = geometry.normalize(self._T @ geometry.exp(odometry.twist * seconds))
        self._stamp = odometry.stamp
        unknown = np.zeros(36)
        return make(
            types.ODOMETRY,
            header(odometry.stamp, self._frame),
            self._base,
            make("geometry_msgs/msg/PoseWithCovariance", _pose(self._T), unknown),
            make("geometry_msgs/msg/TwistWithCovariance", _twist(odometry.twist), unknown),
        )


class RouteTransform:
    """Where the frame of the route is: above that of the robot's own odometry, so that no frame has two parents.

    As ``map`` in REP-105, ``T_route_odom`` corrects what the wheels' odometry has drifted away.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._route: Route | None = None
        self._poses: deque[tuple[int, Array]] = deque(maxlen=_MEMORY)

    def follow(self, route: Route) -> None:
        """Takes a new route."""
        self._route = route

    def moved(self, stamp_ns: int, T_odom_base: Array) -> None:
        """Takes a pose by the robot's own odometry."""
        with self._lock:
            self._poses.append((stamp_ns, T_odom_base))

    def T_route_base(self, localization: Localization) -> Array | None:
        """Where the robot is on the route; None where the route is another, or only the way along it is known."""
        route = self._route
        if route is None or route.id != localization.route or not localization.metric:
            return None
        if localization.trunk_index >= len(route.path):
            return None
        T: Array = route.path[localization.trunk_index] @ localization.T_trunk_robot
        return T

    def T_route_odom(self, localization: Localization) -> Array | None:
        """Where the robot's own odometry began; None where it says nothing of that time."""
        T_route_base = self.T_route_base(localization)
        with self._lock:
            known = list(self._poses)
        near = min(known, key=lambda pose: abs(pose[0] - localization.stamp), default=None)
        if T_route_base is None or near is None or abs(near[0] - localization.stamp) > _NEAR_NS:
            return None
        return T_route_base @ geometry.inverse(near[1])


def _pose(T: Array) -> Any:  # noqa: ANN401
    return make("geometry_msgs/msg/Pose", make("geometry_msgs/msg/Point", *map(float, T[:3, 3])), _quaternion(T))


def _twist(xi: Array) -> Any:  # noqa: ANN401
    return make(types.TWIST, _vector(xi[:3]), _vector(xi[3:]))


def _vector(v: Array) -> Any:  # noqa: ANN401
    return make("geometry_msgs/msg/Vector3", *map(float, v))


def _quaternion(T: Array) -> Any:  # noqa: ANN401
    """Its quaternion with a positive w, from the rotation vector."""
    phi = geometry.so3_log(T[:3, :3])
    half = float(np.linalg.norm(phi)) / 2.0
    x, y, z = phi * (0.5 * np.sinc(half / np.pi))
    return make("geometry_msgs/msg/Quaternion", float(x), float(y), float(z), float(np.cos(half)))
