"""The sensors as a process that has joined a ROS graph, and nodes of that graph by an independent implementation."""

import json
import time

import numpy as np
import pytest
import zenoh
from zenoh_ros2_sdk.qos import QosDurability, QosProfile, QosReliability

from common import geometry, topics
from common.messages import VelocityCommand, now_ns
from services.sensors.ros2 import types
from tests.processes import Robot, eventually, every
from tests.ros import STORE, Nodes, Router, image, image_fields, info_fields
from tests.services.sensors.ros2.samples import CAMERA, NOW, cloud, joy, localization, odometry, route, shaded, twist

TABLES = """
[sensors]
driver = "ros2"
frame_rate = 50.0
[sensors.ros2]
endpoint = "{endpoint}"
domain = 3
dead_man = 1
[sensors.ros2.inputs]
left = "left/image_rect"
right = "right/image_rect"
joystick = "joy"
teleop = "teleop"
[sensors.ros2.outputs]
route = "route"
"""
LATCHED = QosProfile(durability=QosDurability.TRANSIENT_LOCAL, history_depth=1)
SIDES = ("left", "right")


@pytest.fixture(scope="module")
def router():
    with Router() as running:
        yield running


@pytest.fixture(scope="module")
def robot(router, tmp_path_factory):
    tables = TABLES.format(endpoint=router.endpoint)
    with Robot(tmp_path_factory.mktemp("ros2"), tables) as running:
        running.start("sensors")
        yield running


@pytest.fixture(scope="module")
def nodes(router, robot, tmp_path_factory):  # noqa: ARG001, the driver is there
    with Nodes(router.port, tmp_path_factory.mktemp("definitions"), domain=3) as running:
        eventually(lambda: "/right/camera_info" in running.topics(), "the driver joins the graph")
        yield running


@pytest.fixture(scope="module")
def cameras(nodes):
    return Cameras(nodes)


@pytest.fixture(scope="module")
def safety(robot):
    return robot.act_as("safety").publisher(topics.SAFE)


class Cameras:
    """Publishes pairs with their camera infos and the camera's place on the vehicle."""

    def __init__(self, nodes):
        self._nodes = nodes
        self._images = [nodes.publisher(f"/{side}/image_rect", types.IMAGE) for side in SIDES]
        self._infos = [nodes.publisher(f"/{side}/camera_info", types.CAMERA_INFO) for side in SIDES]
        self._static = nodes.publisher("/tf_static", types.TRANSFORMS)

    def see(self, stamp=None, skew=0):
        stamp = stamp or now_ns()
        for right in range(2):
            at = stamp + right * skew
            self._infos[right].publish(**info_fields(CAMERA, bool(right), at, "optical", self._nodes.make))
            self._images[right].publish(**image_fields(shaded(), at, "rgb8", "optical", self._nodes.make))
        vector = self._nodes.make("geometry_msgs/msg/Vector3", 0.3, 0.0, 1.1)
        turn = self._nodes.make("geometry_msgs/msg/Quaternion", -0.5, 0.5, -0.5, 0.5)
        body = self._nodes.make("geometry_msgs/msg/Transform", vector, turn)
        made = self._nodes.make("geometry_msgs/msg/TransformStamped", self._nodes.header(), "optical", body)
        self._static.publish(transforms=[made])

    def await_frame(self, robot, newer_than):
        frames = robot.bus("observer").subscribe(topics.STEREO)
        with every(0.1, self.see):
            return eventually(
                lambda: (last := frames.last()) and last.message.stamp > newer_than and last.message, "a frame", 20.0
            )


def fields(message):
    return {name: getattr(message, name) for name in message.__dataclass_fields__ if name != "__msgtype__"}


def dropped(robot, topic):
    """How many samples of a topic the driver has refused, by its own health."""
    health = robot.bus("observer").subscribe(topics.HEALTH, "sensors")
    return lambda: (last := health.last()) and last.message.dropped.get(f"ros2{topic}", 0)


def test_the_graph_sees_the_driver_as_it_sees_any_node(nodes):
    found = nodes.topics()
    assert found["/cmd_vel"] == ["geometry_msgs/msg/Twist"]
    assert found["/left/image_rect"] == ["sensor_msgs/msg/Image"]
    assert found["/route"] == ["nav_msgs/msg/Path"]
    assert {"/odom", "/joy", "/teleop", "/tf", "/tf_static", "/vtr/odometry", "/right/camera_info"} <= set(found)
    command = nodes.info("/cmd_vel").publishers[0]
    assert (command.node_name, command.node_namespace) == ("retraverse", "/")
    assert QosProfile.decode(command.qos).reliability is QosReliability.RELIABLE
    ours = [e for e in nodes.info("/left/image_rect").subscribers if e.node_name == "retraverse"]
    assert QosProfile.decode(ours[0].qos).reliability is QosReliability.BEST_EFFORT
    assert QosProfile.decode(nodes.info("/route").publishers[0].qos).durability is QosDurability.TRANSIENT_LOCAL


def test_stereo_images_arrive_rectified_and_in_place(robot, cameras):
    frame = cameras.await_frame(robot, 0)
    np.testing.assert_array_equal(frame.left, shaded())
    np.testing.assert_array_equal(frame.right, shaded())
    assert frame.camera.baseline == pytest.approx(CAMERA.baseline)
    # The optical frame looks along x; the transform says where it is.
    np.testing.assert_allclose(frame.camera.T_vehicle_camera @ [0, 0, 1, 1], [1.3, 0.0, 1.1, 1.0], atol=1e-9)


def test_wheels_joystick_and_a_persons_commands_arrive(robot, nodes):
    bus = robot.bus("observer")
    wheels, sticks, commands = (bus.subscribe(t) for t in (topics.WHEEL_ODOMETRY, topics.JOYSTICK, topics.TELEOP))
    senders = [
        nodes.publisher(name, message.__msgtype__)
        for name, message in (("/odom", odometry()), ("/joy", joy()), ("/teleop", twist(0, 0)))
    ]

    def send():
        for sender, message in zip(senders, (odometry(), joy(), twist(0.4, -0.1)), strict=True):
            sender.publish(**fields(message))

    with every(0.05, send):
        assert eventually(wheels.last, "wheel odometry").message.w == 0.5
        assert eventually(sticks.last, "the joystick").message.held
        assert eventually(commands.last, "a person's command").message.v == 0.4


def test_the_base_is_commanded_while_safety_speaks_and_stopped_when_it_falls_silent(nodes, safety):
    heard = []

    def hear(message):
        heard.append((message.linear.x, message.angular.z, time.monotonic()))

    nodes.subscribe("/cmd_vel", "geometry_msgs/msg/Twist", hear)
    with every(0.02, lambda: safety.put(VelocityCommand(stamp=now_ns(), v=0.7, w=-0.3))):
        eventually(lambda: heard and heard[-1][:2] == (0.7, -0.3), "a command")
    eventually(lambda: heard[-1][:2] == (0.0, 0.0), "the base is told to stop")
    eventually(lambda: time.monotonic() - heard[-1][2] > 0.5, "the base is left alone")
    assert heard[-1][:2] == (0.0, 0.0)


def test_a_late_joiner_gets_the_route_and_transforms_follow_the_localization(robot, nodes):
    routes = robot.act_as("navigator").publisher(topics.ROUTE)
    places = robot.act_as("estimator").publisher(topics.LOCALIZATION)
    routes.put(route())
    paths, transforms = [], []
    eventually(
        lambda: paths or nodes.subscribe("/route", types.PATH, paths.append, qos=LATCHED) is None, "the path", 20.0
    )
    assert [pose.pose.position.x for pose in paths[0].poses] == [0.0, 2.0]
    nodes.subscribe("/tf", types.TRANSFORMS, transforms.append)
    wheels = nodes.publisher("/odom", types.ODOMETRY)

    def move():
        stamp = now_ns()
        wheels.publish(**fields(odometry(stamp=stamp)))
        places.put(localization(stamp=stamp))

    with every(0.1, move):
        made = eventually(lambda: transforms and transforms[-1].transforms[0], "a transform")
    assert (made.header.frame_id, made.child_frame_id) == ("vtr_route", "odom")
    T_odom_base = geometry.from_xy_yaw(1.0, 2.0, 2 * np.arctan2(0.6, 0.8))
    wanted = route().path[1] @ localization().T_trunk_robot @ geometry.inverse(T_odom_base)
    assert made.transform.translation.x == pytest.approx(wanted[0, 3])


def test_what_is_wrong_is_dropped_counted_and_ends_nothing(robot, router, cameras):
    key = "3/{}/{}/{}".format
    of_image = key("left/image_rect", "sensor_msgs::msg::dds_::Image_", types.hash_of(types.IMAGE, "jazzy"))
    of_wheels = key("odom", "nav_msgs::msg::dds_::Odometry_", types.hash_of(types.ODOMETRY, "jazzy"))
    bad = odometry(v=np.nan)
    attacks = [
        (of_image, b""),
        (of_image, b"\x00\x01\x00\x00" + bytes(range(256)) * 20),
        (of_image, bytes(4_000_000)),
        (of_image[:-4] + "0000", b"\x00\x01\x00\x00"),
        (key("left/image_rect", "std_msgs::msg::dds_::String_", "RIHS01_00"), b"\x00\x01\x00\x00"),
        (of_wheels, bytes(STORE.serialize_cdr(bad, bad.__msgtype__))),
        (of_wheels, b"\x00\x01\x00\x00" + b"\xff" * 700),
        (of_wheels, bytes(2_000_000)),
    ]
    counted = {topic: dropped(robot, topic) for topic in ("/left/image_rect", "/odom")}
    with session(router) as stranger:
        for name, payload in attacks:
            stranger.put(name, payload)
            time.sleep(0.02)
        eventually(lambda: (counted["/left/image_rect"]() or 0) >= 5, "bad images are counted")
        eventually(lambda: (counted["/odom"]() or 0) >= 3, "bad odometry is counted")
    assert robot.alive("sensors")
    assert cameras.await_frame(robot, now_ns()).left.shape == shaded().shape


def test_images_of_different_moments_are_no_pair(robot, cameras):
    frames = robot.bus("observer").subscribe(topics.STEREO)
    cameras.await_frame(robot, now_ns())
    sent, seen = {"apart": [], "together": []}, []

    def see(kind, skew):
        sent[kind].append(now_ns())
        cameras.see(sent[kind][-1], skew)

    def received():
        if (frame := frames.poll()) is not None:
            seen.append(frame.message.stamp)
        return set(seen) & set(sent["together"])

    with every(0.2, lambda: see("apart", 50_000_000)):
        eventually(lambda: received() is not None and len(sent["apart"]) > 3, "images that are apart are sent")
    with every(0.2, lambda: see("together", 2_000_000)):
        eventually(received, "a pair whose stamps differ a little")
    assert not set(seen) & set(sent["apart"])


def test_the_driver_survives_the_graphs_router(robot, router, cameras, safety):
    router.restart()
    heard = []
    with session(router) as listener, every(0.02, lambda: safety.put(VelocityCommand(stamp=now_ns(), v=0.5, w=0.0))):
        listener.declare_subscriber("3/cmd_vel/**", lambda sample: heard.append(sample.payload.to_bytes()))
        eventually(lambda: heard, "commands again", 20.0)
    assert STORE.deserialize_cdr(heard[-1], types.TWIST).linear.x == 0.5
    assert cameras.await_frame(robot, now_ns()).stamp
    assert robot.alive("sensors")


def test_behind_a_bridge_topics_have_its_namespace_and_no_types(router, robot, tmp_path):
    tables = (
        f'[sensors]\ndriver = "ros2"\n[sensors.ros2]\nendpoint = "{router.endpoint}"\ntransport = "bridge"\n'
        'namespace = "/bot"\nmounting = "none"\nstamped = true\n'
        '[sensors.ros2.inputs]\nimage = "image"\npoints = "/points"\n'
    )
    messages = {"odom": odometry(v=0.9), "image": image(shaded(), NOW, "bgr8"), "points": cloud()}
    payloads = {name: bytes(STORE.serialize_cdr(m, m.__msgtype__)) for name, m in messages.items()}
    with Robot(tmp_path, tables, "r2", robot) as second:
        sensors = second.start("sensors")
        safe, observer = second.act_as("safety").publisher(topics.SAFE), second.bus("observer")
        wheels, frames, scans = (observer.subscribe(t) for t in (topics.WHEEL_ODOMETRY, topics.CAMERA, topics.LIDAR))
        heard = []

        def send():
            safe.put(VelocityCommand(stamp=now_ns(), v=0.2, w=0.1))
            for name, payload in payloads.items():
                bridge.put(f"bot/{name}", payload)

        with session(router) as bridge:
            bridge.declare_subscriber("bot/cmd_vel", lambda sample: heard.append(sample.payload.to_bytes()))
            with every(0.05, send):
                assert eventually(wheels.last, "wheel odometry").message.v == 0.9
                np.testing.assert_array_equal(eventually(frames.last, "an image").message.image, shaded()[..., ::-1])
                np.testing.assert_allclose(eventually(scans.last, "a scan").message.ranges, 5.0, atol=1e-4)
                eventually(lambda: heard, "a command")
                assert speed(heard[-1]) == 0.2
                sensors.terminate()
                eventually(lambda: speed(heard[-1]) == 0.0, "the last command stops the base")
                assert sensors.wait(5.0) == 0


def speed(payload):
    return STORE.deserialize_cdr(payload, types.TWIST_STAMPED).twist.linear.x


def session(router):
    """Somebody else in the ROS side's Zenoh."""
    config = zenoh.Config()
    for name, value in {
        "mode": "client",
        "connect/endpoints": [router.endpoint],
        "scouting/multicast/enabled": False,
    }.items():
        config.insert_json5(name, json.dumps(value))
    return zenoh.open(config)
