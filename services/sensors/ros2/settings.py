"""``[sensors.ros2]``: where the ROS graph is, and which of its topics is which of the robot's own."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

from services.sensors.ros2.names import check_name, sibling

Transport = Literal["rmw_zenoh", "bridge"]
Distro = Literal["humble", "iron", "jazzy", "kilted", "lyrical", "rolling"]


@dataclass(frozen=True, slots=True)
class InputSettings:
    """``[sensors.ros2.inputs]``: topics that are listened to; an empty name is none.

    A name that begins with a slash is absolute, any other one is below the namespace. Images are
    ``sensor_msgs/Image``, and ``sensor_msgs/CompressedImage`` where the name ends with ``/compressed``.

    Attributes:
        left, right: images of the stereo pair.
        left_info, right_info: its ``sensor_msgs/CameraInfo``; where empty, ``camera_info`` beside the images.
        image: images of one camera alone, for a robot that localizes by bearing.
        points: ``sensor_msgs/PointCloud2`` of a spinning lidar.
        odometry: ``nav_msgs/Odometry`` of the wheels; its twist is used, and its pose for the transforms that go out.
        joystick: ``sensor_msgs/Joy``, for the dead man's switch and the emergency stop's button.
        teleop: ``geometry_msgs/Twist`` by which a person drives while a route is taught.
        static_transforms: ``tf2_msgs/TFMessage``, latched, with the places of the sensors.
    """

    left: str = ""
    right: str = ""
    left_info: str = ""
    right_info: str = ""
    image: str = ""
    points: str = ""
    odometry: str = "odom"
    joystick: str = ""
    teleop: str = ""
    static_transforms: str = "/tf_static"

    def __post_init__(self) -> None:
        """Refuses names that are none, one image of a pair without the other, and a robot that senses nothing.

        Raises:
            ValueError: one of these.
        """
        _check_names(self)
        if bool(self.left) != bool(self.right):
            raise ValueError("`left` and `right` are named both, or neither.")

    @property
    def infos(self) -> tuple[str, str]:
        """The camera infos of the left and of the right image."""
        return self.left_info or sibling(self.left, "camera_info"), self.right_info or sibling(
            self.right, "camera_info"
        )


@dataclass(frozen=True, slots=True)
class OutputSettings:
    """``[sensors.ros2.outputs]``: topics that are published; an empty name is none.

    Attributes:
        command: the velocity command, the only one that the base may obey.
        route: ``nav_msgs/Path`` of the route, as long as there is one.
        odometry: ``nav_msgs/Odometry`` by the robot's eyes.
        transforms: ``tf2_msgs/TFMessage``: where the route's frame is, while the robot localizes on it.
    """

    command: str = "cmd_vel"
    route: str = "vtr/route"
    odometry: str = "vtr/odometry"
    transforms: str = "/tf"

    def __post_init__(self) -> None:
        """Refuses names that are none.

        Raises:
            ValueError: a name is none.
        """
        _check_names(self)


@dataclass(frozen=True, slots=True)
class FrameSettings:
    """``[sensors.ros2.frames]``: names of frames in ROS's transforms.

    Attributes:
        base: the vehicle's own: x forward, y left, z up, between its wheels.
        odometry: the parent of ``base`` in the robot's own transforms. ``vtr_route`` is put above it, as ``map`` is by
            others; where empty, directly above ``base``.
        route: the first vertex of the route.
        visual: the frame of the odometry by the robot's eyes, which no transform leads to.
    """

    base: str = "base_link"
    odometry: str = "odom"
    route: str = "vtr_route"
    visual: str = "vtr_odom"

    def __post_init__(self) -> None:
        """Refuses frames without a name, and two of one name.

        Raises:
            ValueError: one of these.
        """
        names = [self.base, self.route, self.visual, *filter(None, [self.odometry])]
        if "" in names or len(set(names)) != len(names):
            raise ValueError("`base`, `odometry`, `route` and `visual` are four names.")


@dataclass(frozen=True, slots=True)
class Ros2Settings:
    """``[sensors.ros2]``: the driver ``ros2``.

    Attributes:
        endpoint: the Zenoh router of the ROS graph: ``rmw_zenohd``, or the bridge itself.
        transport: what put the graph on Zenoh: ``rmw_zenoh``, or ``bridge`` for ``zenoh-bridge-ros2dds``.
        domain: the graph's ``ROS_DOMAIN_ID``; keys of a bridge have none.
        namespace: where relative names begin, and the namespace of the node that this driver is; of a bridge its own,
            which it puts before every name.
        node: the node's name.
        distro: of ROS: Humble has no hashes of types.
        mounting: where the sensors sit on the vehicle: as ``/tf_static`` tells, without which nothing is published, or
            ``none``: at the vehicle's origin.
        stamped: whether the velocity command is a ``TwistStamped``.
        teleop_stamped: whether the one of ``teleop`` is.
        dead_man: number of the joystick's button that is the dead man's switch, counted from 0; None for no button.
        tolerance: seconds that the stamps of the two images of a pair may be apart.
        inputs, outputs, frames: names.
    """

    endpoint: str = "tcp/127.0.0.1:7447"
    transport: Transport = "rmw_zenoh"
    domain: int = 0
    namespace: str = "/"
    node: str = "retraverse"
    distro: Distro = "jazzy"
    mounting: Literal["tf", "none"] = "tf"
    stamped: bool = False
    teleop_stamped: bool = False
    dead_man: int | None = None
    tolerance: float = 0.005
    inputs: InputSettings = field(default_factory=InputSettings)
    outputs: OutputSettings = field(default_factory=OutputSettings)
    frames: FrameSettings = field(default_factory=FrameSettings)

    def __post_init__(self) -> None:
        """Refuses what is no graph.

        Raises:
            ValueError: an address, a domain, a name, a button or a tolerance that is none.
        """
        kind, _, address = self.endpoint.partition("/")
        if kind not in ("tcp", "tls", "quic", "udp", "unixsock-stream") or not address:
            raise ValueError("`endpoint` is an address as 'tcp/192.168.1.2:7447'.")
        if not 0 <= self.domain <= 232:
            raise ValueError(f"`domain` is {self.domain}; ROS has 0 to 232.")
        if self.namespace != "/":
            check_name(self.namespace, "namespace")
        if "/" in self.node or not self.node:
            raise ValueError("`node` is a name without a slash.")
        check_name(self.node, "node")
        if self.dead_man is not None and not 0 <= self.dead_man < 32:
            raise ValueError(f"`dead_man` is {self.dead_man}; buttons are counted from 0 to 31.")
        if not 0.0 <= self.tolerance < 1.0:
            raise ValueError(f"`tolerance` is {self.tolerance} s; it must be at least 0 and below 1.")


def _check_names(topics: InputSettings | OutputSettings) -> None:
    for name in topics.__slots__:
        check_name(getattr(topics, name), name)
