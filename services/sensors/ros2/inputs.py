"""ROS's small messages as ours."""

from __future__ import annotations

from typing import Any, TypeVar

import numpy as np
from pydantic import ValidationError

from common import geometry
from common.geometry import Array
from common.messages import Joystick, Message, VelocityCommand, WheelOdometry
from services.sensors.ros2.errors import RosDataError
from services.sensors.ros2.types import stamp_of

M = TypeVar("M", bound=Message)

_AXES, _BUTTONS = 16, 32


def wheel_odometry(message: Any, now_ns: int) -> WheelOdometry:  # noqa: ANN401, classes that rosbags makes at run time
    """Speed and turn rate of a ``nav_msgs/Odometry``; ``now_ns`` where it has no stamp.

    Raises:
        RosDataError: they are not finite, or of no vehicle.
    """
    twist = message.twist.twist
    return _checked(
        WheelOdometry, stamp=stamp_of(message.header) or now_ns, v=float(twist.linear.x), w=float(twist.angular.z)
    )


def pose(message: Any) -> Array | None:  # noqa: ANN401
    """``T_odom_base`` (4, 4) of a ``nav_msgs/Odometry``; None where its quaternion is 0, for nobody has set it.

    Raises:
        RosDataError: it is no pose.
    """
    q, t = message.pose.pose.orientation, message.pose.pose.position
    rotation, translation = np.array([q.x, q.y, q.z, q.w]), np.array([t.x, t.y, t.z])
    norm = float(np.linalg.norm(rotation))
    if norm == 0.0:
        return None
    if not (np.isfinite(norm) and np.isfinite(translation).all() and abs(norm - 1.0) < 0.1):
        raise RosDataError("the pose is none: its quaternion has not the length 1, or it is not finite")
    x, y, z, w = rotation / norm
    R = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )
    return geometry.transform(R, translation)


def joystick(message: Any, dead_man: int | None, now_ns: int) -> Joystick:  # noqa: ANN401
    """A ``sensor_msgs/Joy``; the button ``dead_man`` is the dead man's switch, which None and a missing one never hold.

    Raises:
        RosDataError: an axis is not finite, or beyond 1.
    """
    buttons = [bool(value) for value in message.buttons[:_BUTTONS]]
    held = dead_man is not None and dead_man < len(buttons) and buttons[dead_man]
    axes = [float(value) for value in message.axes[:_AXES]]
    return _checked(Joystick, stamp=stamp_of(message.header) or now_ns, axes=axes, held=held, buttons=buttons)


def velocity(message: Any, now_ns: int) -> VelocityCommand:  # noqa: ANN401
    """A ``geometry_msgs/Twist`` or ``TwistStamped``: its speed forward and its turn rate.

    Raises:
        RosDataError: they are not finite.
    """
    twist = getattr(message, "twist", message)
    return _checked(VelocityCommand, stamp=now_ns, v=float(twist.linear.x), w=float(twist.angular.z))


def _checked(kind: type[M], **values: Any) -> M:  # noqa: ANN401
    try:
        return kind(**values)
    except ValidationError as error:
        first = error.errors(include_url=False, include_input=False)[0]
        raise RosDataError(f"'{'.'.join(map(str, first['loc']))}': {first['msg']}") from None
