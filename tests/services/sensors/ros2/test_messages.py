"""What ROS's messages become, and what comes of those that are wrong."""

import contextlib
from dataclasses import replace

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from common import geometry
from common.camera import OPTICAL_IN_VEHICLE
from common.messages import Odometry
from services.sensors.calibration.rectify import Rectifier
from services.sensors.calibration.simulation import simulated_rig
from services.sensors.recordings.ros.frames import StaticFrames
from services.sensors.ros2 import inputs, outputs, types
from services.sensors.ros2.cameras import StereoPair, pixels, size_of
from services.sensors.ros2.errors import RosDataError
from services.sensors.ros2.scans import scan
from services.sensors.settings import CameraSettings
from tests.ros import ROOTS, STORE, header, image, make
from tests.services.sensors.ros2.samples import (
    CAMERA,
    MS,
    NOW,
    cloud,
    info,
    joy,
    localization,
    odometry,
    route,
    shaded,
    through_cdr,
    twist,
    vector,
)

LIGHT = CameraSettings()
SIDES = ("/left/image_rect", "/right/image_rect")


# --- CDR


def test_pixels_are_a_view_of_the_payload():
    payload = types.encode(image(shaded(), NOW, "rgb8"))
    found = pixels(types.decode(types.IMAGE, payload), "/left")
    assert np.shares_memory(found, np.frombuffer(payload, np.uint8))
    np.testing.assert_array_equal(found, shaded())


@pytest.mark.parametrize("little_endian", [True, False])
def test_both_byte_orders_are_read(little_endian):
    message = odometry()
    data = bytes(STORE.serialize_cdr(message, message.__msgtype__, little_endian=little_endian))
    assert inputs.wheel_odometry(types.decode(types.ODOMETRY, data), 0).v == 1.0


@given(st.sampled_from(ROOTS), st.binary(max_size=400))
def test_random_bytes_are_refused_or_a_message(type_name, data):
    for payload in (data, b"\x00\x01\x00\x00" + data):
        with contextlib.suppress(RosDataError):
            assert types.decode(type_name, payload).__msgtype__ == type_name


@settings(max_examples=200)
@given(st.sampled_from(["image", "info", "odometry", "joy", "cloud"]), st.data())
def test_a_damaged_message_is_used_or_refused_and_nothing_else(kind, data):
    whole = bytearray(types.encode(SAMPLES[kind]()))
    for _ in range(data.draw(st.integers(1, 4))):
        whole[data.draw(st.integers(0, len(whole) - 1))] = data.draw(st.integers(0, 255))
    cut = bytes(whole[: data.draw(st.integers(len(whole) // 2, len(whole)))])
    with contextlib.suppress(RosDataError):
        USES[kind](types.decode(SAMPLES[kind]().__msgtype__, cut))


def test_a_sample_that_is_too_large_is_not_looked_at():
    with pytest.raises(RosDataError, match="too much"):
        types.decode(types.ODOMETRY, bytes(1_000_001))


# --- cameras


def test_rectified_images_become_a_frame():
    pair = StereoPair.by_infos((info(), info(right=True)), SIDES, OPTICAL_IN_VEHICLE, LIGHT)
    left, right = shaded(), np.ascontiguousarray(shaded()[::-1])
    frame = pair.frame(*(through_cdr(image(side, NOW, "rgb8")) for side in (left, right)), NOW)
    np.testing.assert_array_equal(frame.left, left)
    np.testing.assert_array_equal(frame.right, right)
    assert frame.camera.baseline == pytest.approx(0.12)
    assert frame.camera.fx == 50.0


@pytest.mark.parametrize("form", ["jpeg", "png"])
def test_compressed_images_become_pixels(form):
    smooth = cv2.GaussianBlur(shaded(), (0, 0), 5.0)
    data = cv2.imencode(f".{form}", cv2.cvtColor(smooth, cv2.COLOR_RGB2BGR))[1].reshape(-1)
    message = make("sensor_msgs/msg/CompressedImage", header(stamp_ns=NOW), f"rgb8; {form} compressed bgr8", data)
    found = pixels(through_cdr(message), "/left/compressed", (64, 48))
    assert np.abs(found.astype(int) - smooth).mean() < 3.0
    message.data = data[: len(data) // 2]
    with pytest.raises(RosDataError, match="cut short"):
        pixels(through_cdr(message), "/left/compressed")


def test_a_header_that_claims_a_huge_image_is_refused_before_it_is_decoded():
    data = bytearray(cv2.imencode(".png", shaded())[1].tobytes())
    data[16:24] = (60000).to_bytes(4, "big") * 2
    message = make("sensor_msgs/msg/CompressedImage", header(stamp_ns=NOW), "png", np.frombuffer(data, np.uint8))
    assert size_of(bytes(data)) == (60000, 60000)
    with pytest.raises(RosDataError, match="60000"):
        pixels(message, "/left/compressed")


def test_raw_images_are_rectified_to_where_the_pairs_camera_sees_things():
    rig = simulated_rig()
    lenses = (rig.left, rig.right)
    size = (rig.width, rig.height)
    R1, R2, P1, P2, *_ = cv2.stereoRectify(
        rig.left.matrix, rig.left.distortion, rig.right.matrix, rig.right.distortion, size, rig.R, rig.T.reshape(3, 1)
    )
    infos = tuple(
        info(
            replace(CAMERA, width=rig.width, height=rig.height), d=lens.distortion, k=lens.matrix.reshape(-1),
            r=R.reshape(-1), p=P.reshape(-1),
        )
        for lens, R, P in zip(lenses, (R1, R2), (P1, P2), strict=True)
    )  # fmt: skip
    point = np.array([[0.15, -0.08, 2.0]])
    raw = []
    for lens, R, t in ((rig.left, np.eye(3), np.zeros(3)), (rig.right, rig.R, rig.T)):
        u, v = cv2.projectPoints(point @ R.T + t, np.zeros(3), np.zeros(3), lens.matrix, lens.distortion)[0].reshape(2)
        rows, columns = np.mgrid[: rig.height, : rig.width]
        raw.append((250 * np.exp(-((columns - u) ** 2 + (rows - v) ** 2) / 18.0)).astype(np.uint8))
    pair = StereoPair.by_infos(infos, ("/left/image_raw", "/right/image_raw"), None, LIGHT)
    by_calibration = StereoPair.by_calibration(Rectifier.of(rig), SIDES)
    for made in (pair, by_calibration):
        frame = made.frame(*(through_cdr(image(side, NOW, "mono8")) for side in raw), NOW)
        seen = [_middle(side) for side in (frame.left, frame.right)]
        wanted = made.model.camera().project((point @ R1.T)[0])
        np.testing.assert_allclose([seen[0][0], seen[0][1], seen[1][0]], wanted, atol=0.15)


def _middle(picture):
    rows, columns = np.mgrid[: picture.shape[0], : picture.shape[1]]
    weight = picture.astype(float)
    return (columns * weight).sum() / weight.sum(), (rows * weight).sum() / weight.sum()


@pytest.mark.parametrize(
    ("wrong", "sentence"),
    [
        ({"width": 10**9}, "pixels"),
        ({"p": np.full(12, np.nan)}, "finite"),
        ({"p": np.zeros(12)}, "focal length"),
        ({"distortion_model": "cubic", "d": np.ones(5)}, "no pair|cubic"),
    ],
)
def test_a_camera_info_that_is_none_is_refused(wrong, sentence):
    with pytest.raises(RosDataError, match=sentence):
        StereoPair.by_infos(
            (info(**wrong), info(right=True)), ("/left/image_raw", "/right/image_raw"), OPTICAL_IN_VEHICLE, LIGHT
        )


@pytest.mark.parametrize(
    ("wrong", "sentence"),
    [({"encoding": "yuv422"}, "yuv422"), ({"height": 47}, "64x47"), ({"step": 1}, "not whole"), ({"width": 0}, "0x48")],
)
def test_an_image_that_does_not_fit_is_refused(wrong, sentence):
    pair = StereoPair.by_infos((info(), info(right=True)), SIDES, OPTICAL_IN_VEHICLE, LIGHT)
    good, bad = image(shaded(), NOW, "rgb8"), image(shaded(), NOW, "rgb8")
    for name, value in wrong.items():
        setattr(bad, name, value)
    with pytest.raises(RosDataError, match=sentence):
        pair.frame(good, bad, NOW)
    with pytest.raises(RosDataError, match="grey"):
        pair.frame(good, image(shaded(channels=1), NOW, "mono8"), NOW)


# --- lidar


def test_a_cloud_becomes_a_scan():
    found = scan(through_cdr(cloud()), np.eye(4), 0, "/points")
    np.testing.assert_allclose(found.ranges, 5.0, atol=1e-4)
    np.testing.assert_allclose(found.intensities, 7.0)
    assert found.stamp == NOW


@pytest.mark.parametrize(
    "wrong",
    [
        {"width": 2**31},
        {"point_step": 0},
        {"row_step": 3},
        {"fields": []},
        {"fields": [make("sensor_msgs/msg/PointField", name, 2**31, 7, 1) for name in "xyz"]},
        {"fields": [make("sensor_msgs/msg/PointField", "x", 0, 99, 1)] * 3},
        {"data": np.zeros(10, np.uint8)},
    ],
)
def test_a_cloud_that_is_none_is_refused(wrong):
    with pytest.raises(RosDataError):
        scan(through_cdr(cloud(**wrong)), np.eye(4), 0, "/points")


def test_points_that_are_not_finite_are_no_returns():
    message = cloud()
    data = message.data.copy()
    data[:4] = np.frombuffer(np.float32(np.nan).tobytes(), np.uint8)
    message.data = data
    found = scan(through_cdr(message), np.eye(4), 0, "/points")
    assert found.ranges[0, 0] == 0.0
    assert np.count_nonzero(found.ranges) == found.ranges.size - 1


# --- wheels, joystick, commands


def test_wheel_odometry_is_the_twist_and_its_pose_the_robots_own():
    message = through_cdr(odometry())
    assert inputs.wheel_odometry(message, 1).model_dump() == {"stamp": NOW, "v": 1.0, "w": 0.5}
    assert inputs.wheel_odometry(through_cdr(odometry(stamp=0)), 77).stamp == 77
    T = inputs.pose(message)
    assert geometry.yaw_of(T) == pytest.approx(2 * np.arctan2(0.6, 0.8))
    np.testing.assert_allclose(T[:3, 3], [1.0, 2.0, 0.0])


@pytest.mark.parametrize("value", [np.nan, np.inf, 1e9])
def test_a_twist_that_is_none_is_refused(value):
    with pytest.raises(RosDataError):
        inputs.wheel_odometry(odometry(v=value), NOW)
    if not np.isfinite(value):
        with pytest.raises(RosDataError):
            inputs.velocity(twist(value, 0.0), NOW)


def test_a_pose_that_is_none_is_refused():
    for quaternion in ((0.0, 0.0, 0.0, 0.5), (np.nan, 0.0, 0.0, 1.0)):
        with pytest.raises(RosDataError):
            inputs.pose(odometry(quaternion=quaternion))
    assert inputs.pose(odometry(quaternion=(0.0,) * 4)) is None


def test_a_stamp_that_is_no_time_is_refused():
    message = odometry()
    message.header.stamp.nanosec = 1_000_000_000
    with pytest.raises(RosDataError, match="no time"):
        inputs.wheel_odometry(message, NOW)


def test_a_joysticks_button_holds_the_dead_mans_switch():
    assert inputs.joystick(through_cdr(joy()), 1, NOW).held
    for dead_man in (0, 2, 9, None):
        assert not inputs.joystick(through_cdr(joy()), dead_man, NOW).held
    assert inputs.joystick(joy(buttons=(1,) * 50, axes=(0.1,) * 40), 1, NOW).axes == pytest.approx([0.1] * 16)
    with pytest.raises(RosDataError):
        inputs.joystick(joy(axes=(np.nan,)), 1, NOW)


def test_a_person_commands_by_both_kinds_of_twist():
    stamped = make("geometry_msgs/msg/TwistStamped", header(), twist(0.4, -0.2))
    for message in (twist(0.4, -0.2), stamped):
        found = inputs.velocity(through_cdr(message), NOW)
        assert (found.v, found.w) == (0.4, -0.2)


# --- what goes out


def test_a_velocity_is_the_twist_that_rosbags_reads():
    found = STORE.deserialize_cdr(types.encode(outputs.twist(0.7, -0.3)), types.TWIST)
    assert (found.linear.x, found.angular.z, found.linear.y) == (0.7, -0.3, 0.0)
    stamped = STORE.deserialize_cdr(
        types.encode(outputs.twist_stamped(0.7, -0.3, NOW, "base_link")), types.TWIST_STAMPED
    )
    assert stamped.header.frame_id == "base_link"
    assert types.stamp_of(stamped.header) == NOW
    assert stamped.twist.linear.x == 0.7


def test_a_routes_path_has_a_pose_for_each_vertex():
    found = STORE.deserialize_cdr(types.encode(outputs.path(route(), "vtr_route", NOW)), types.PATH)
    assert found.header.frame_id == "vtr_route"
    pose = found.poses[1].pose
    assert (pose.position.x, pose.position.y) == (2.0, 1.0)
    assert 2 * np.arctan2(pose.orientation.z, pose.orientation.w) == pytest.approx(1.2)


def test_the_routes_frame_is_put_above_the_odometrys_so_that_the_robot_is_where_it_localized():
    where = outputs.RouteTransform()
    T_odom_base = geometry.from_xy_yaw(7.0, -3.0, 2.0)
    where.moved(NOW - 500 * MS, np.eye(4))
    where.moved(NOW + 3 * MS, T_odom_base)
    assert where.T_route_odom(localization()) is None
    where.follow(route())
    T_route_base = route().path[1] @ localization().T_trunk_robot
    T = where.T_route_odom(localization())
    np.testing.assert_allclose(T @ T_odom_base, T_route_base, atol=1e-12)
    np.testing.assert_allclose(where.T_route_base(localization()), T_route_base)
    sent = STORE.deserialize_cdr(types.encode(outputs.transform(T, NOW, "vtr_route", "odom")), types.TRANSFORMS)
    frames = StaticFrames([sent], vehicles=("vtr_route",))
    np.testing.assert_allclose(frames.T_vehicle("odom"), T, atol=1e-12)


def test_nothing_is_told_of_another_route_or_of_one_without_poses_or_of_another_time():
    where = outputs.RouteTransform()
    where.moved(NOW, np.eye(4))
    where.follow(route())
    for other in ({"route": "s"}, {"metric": False}, {"trunk_index": 2}, {"stamp": NOW + 300 * MS}):
        assert where.T_route_odom(localization(**other)) is None


def test_odometry_by_eye_is_the_sum_of_its_twists():
    visual = outputs.VisualOdometry("vtr_odom", "base_link")
    stamps = [NOW, NOW + 100 * MS, NOW + 200 * MS, NOW + 200 * MS, NOW + 5000 * MS]
    for stamp in stamps:
        last = visual.message(
            Odometry(
                stamp=stamp, vertex=None, T_vertex_robot=np.eye(4), covariance=np.eye(6),
                twist=np.array([1.0, 0, 0, 0, 0, 0.5]), success=True, inliers=1,
            )
        )  # fmt: skip
    found = STORE.deserialize_cdr(types.encode(last), types.ODOMETRY)
    wanted = geometry.exp(np.array([0.2, 0, 0, 0, 0, 0.1]))
    assert found.pose.pose.position.x == pytest.approx(wanted[0, 3])
    assert found.pose.pose.position.y == pytest.approx(wanted[1, 3])
    assert (found.header.frame_id, found.child_frame_id) == ("vtr_odom", "base_link")


def test_static_transforms_that_are_none_are_left_out():
    turn = make("geometry_msgs/msg/Quaternion", 0.0, 0.0, 0.0, 1.0)

    def told(child, x, rotation=turn):
        body = make("geometry_msgs/msg/Transform", vector(x, 0, 0), rotation)
        return make("geometry_msgs/msg/TransformStamped", header(frame="base"), child, body)

    nothing = make("geometry_msgs/msg/Quaternion", 0.0, 0.0, 0.0, 0.0)
    frames = StaticFrames(vehicles=("base",))
    frames.add(make("tf2_msgs/msg/TFMessage", [told("a", np.nan), told("b", 2.0), told("c", 1.0, nothing)]))
    assert frames.T_vehicle("a") is None
    assert frames.T_vehicle("b")[0, 3] == 2.0
    assert frames.T_vehicle("base_link") is None


SAMPLES = {
    "image": lambda: image(shaded(8 * 2, 16), NOW, "rgb8"),
    "info": info,
    "odometry": odometry,
    "joy": joy,
    "cloud": lambda: cloud(2, 16),
}
USES = {
    "image": lambda message: pixels(message, "/left"),
    "info": lambda message: StereoPair.by_infos((message, info(right=True)), SIDES, OPTICAL_IN_VEHICLE, LIGHT),
    "odometry": lambda message: (inputs.wheel_odometry(message, NOW), inputs.pose(message)),
    "joy": lambda message: inputs.joystick(message, 1, NOW),
    "cloud": lambda message: scan(message, np.eye(4), NOW, "/points"),
}
