"""Bags of both ROSes, written by rosbags, as drives."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from mcap.writer import Writer as McapWriter

from common import topics
from services.sensors.recordings import RecordingError
from services.sensors.recordings.opening import Names, open_timeline
from services.sensors.recordings.ros import is_bag, open_bag, parse_map
from tests.services.sensors.recordings.bags import (
    BASELINE,
    FRAMES,
    FX,
    KINDS,
    MS,
    SIZE,
    START,
    Bag,
    at,
    pixels,
)


@pytest.fixture(params=KINDS)
def bag(request, tmp_path):
    names = {"ros1": "drive.bag", "ros1 in mcap": "drive.mcap"}
    return Bag(request.param, tmp_path / names.get(request.param, "drive"))


def write_stereo(bag, *, infos=True, odometry=True, right_late=0):
    with bag:
        bag.put("/tf_static", bag.static("camera", (0.3, 0.06, 0.9)), START)
        for n in range(FRAMES):
            for side, name in enumerate(("left", "right")):
                stamp = at(n) + side * right_late
                if infos:
                    bag.put(f"/cam/{name}/camera_info", bag.info(stamp, right=bool(side)), at(n) + 20 * MS)
                bag.put(f"/cam/{name}/image_raw", bag.image(stamp, pixels(n, side)), at(n) + 21 * MS + side)
            if odometry:
                bag.put("/odom", bag.odometry(at(n), 0.5 + n, -0.25), at(n) + 1)
    return bag.path


def test_a_stereo_bag_plays_by_itself(bag):
    recording = open_bag(write_stereo(bag), [])
    assert recording.counts == {"sensor/stereo/front": FRAMES, "sensor/odometry": FRAMES}
    entries = list(recording.entries())
    assert [e.time_ns for e in entries] == sorted(e.time_ns for e in entries)
    frames = [e.message for e in entries if e.topic is topics.STEREO]
    assert [f.stamp for f in frames] == [at(n) for n in range(FRAMES)]
    for n, frame in enumerate(frames):
        np.testing.assert_array_equal(frame.left, pixels(n, 0))
        np.testing.assert_array_equal(frame.right, pixels(n, 1))
    camera = frames[0].camera
    assert (camera.fx, camera.cx, camera.cy) == (FX, 31.5, 23.5)
    assert camera.baseline == pytest.approx(BASELINE)
    np.testing.assert_allclose(camera.T_vehicle_camera[:3, 3], [0.3, 0.06, 0.9])
    np.testing.assert_allclose(camera.T_vehicle_camera[:3, 2], [1, 0, 0], atol=1e-12, err_msg="it looks ahead")
    wheels = [e.message for e in entries if e.topic is topics.WHEEL_ODOMETRY]
    assert [(m.v, m.w) for m in wheels] == [(0.5 + n, -0.25) for n in range(FRAMES)]


def test_a_part_of_a_bag_is_read(bag):
    recording = open_bag(write_stereo(bag), [])
    wanted = [e.message.v for e in recording.entries(at(2), at(4)) if e.topic is topics.WHEEL_ODOMETRY]
    assert wanted == [2.5, 3.5]


def test_images_that_were_taken_together_are_joined_and_others_are_left_out(bag):
    late = open_bag(write_stereo(bag, right_late=2 * MS), [])
    assert sum(e.topic is topics.STEREO for e in late.entries()) == FRAMES


def test_images_of_other_moments_are_no_pair(bag):
    apart = open_bag(write_stereo(bag, right_late=40 * MS), [])
    assert sum(e.topic is topics.STEREO for e in apart.entries()) == 0


def test_a_pair_without_camera_info_is_refused_with_the_way_out(bag):
    path = write_stereo(bag, infos=False)
    with pytest.raises(RecordingError, match=r"no camera info.*/cam/left/camera_info.*sensor/stereo/front.left.info"):
        open_bag(path, [])
    alone = open_bag(path, parse_map(["/odom=sensor/odometry"]))
    assert alone.counts == {"sensor/odometry": FRAMES}


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("/cam/left", "write /bags/topic=KEY"),
        ("/odom=state", "write /bags/topic=KEY"),
        ("/cam/left=sensor/stereo/front", "which image of the pair"),
        ("/odom=sensor/odometry.left", "has no '.left'"),
    ],
)
def test_a_mapping_that_means_nothing_is_refused(text, sentence):
    with pytest.raises(RecordingError, match=sentence):
        parse_map([text])


@pytest.mark.parametrize(
    ("texts", "sentence"),
    [
        (["/nowhere=sensor/odometry"], r"no topic '/nowhere'.*/odom \(Odometry\)"),
        (["/odom=sensor/lidar/top"], "is a nav_msgs/msg/Odometry"),
        (["/cam/left=sensor/stereo/front.left"], "the right image of camera 'front' is missing"),
    ],
)
def test_a_mapping_that_does_not_fit_the_bag_is_refused(tmp_path, texts, sentence):
    path = write_stereo(Bag("sqlite3", tmp_path / "drive"))
    with pytest.raises(RecordingError, match=sentence):
        open_bag(path, parse_map(texts))


def test_names_and_namespaces_are_mapped(tmp_path):
    path = write_stereo(Bag("ros1", tmp_path / "drive.bag"))
    wishes = ["/cam/left=sensor/stereo/rear.left", "/cam/right/image_raw=sensor/stereo/rear.right"]
    pair = open_bag(path, parse_map(wishes))
    assert pair.counts == {"sensor/stereo/rear": FRAMES}
    mono = open_bag(path, parse_map(["/cam/left=sensor/camera/eye"]))
    first = next(mono.entries())
    assert first.key == "sensor/camera/eye"
    np.testing.assert_array_equal(first.message.image, pixels(0))


def test_a_joystick_is_played_only_when_asked_for_and_held_by_its_button(bag):
    with bag:
        for n in range(3):
            bag.put("/joy", bag.joy(at(n), [0.5, -3.0], [0, n]), at(n))
            bag.put("/odom", bag.odometry(at(n), 1.0, 0.0), at(n))
    assert open_bag(bag.path, []).counts == {"sensor/odometry": 3}
    chosen = open_bag(bag.path, parse_map(["/joy=sensor/joystick.1"]))
    assert [(e.message.axes, e.message.held) for e in chosen.entries()] == [
        ([0.5, -1.0], False), ([0.5, -1.0], True), ([0.5, -1.0], True)
    ]  # fmt: skip
    without = open_bag(bag.path, parse_map(["/joy=sensor/joystick"]))
    assert not any(e.message.held for e in without.entries())


def spinning(beams=8, columns=64):
    """A turn in the order of firing, clockwise, as (ranges (H, W), elevations, azimuths)."""
    rng = np.random.default_rng(3)
    return (
        rng.uniform(2, 30, (beams, columns)),
        np.linspace(-0.3, 0.2, beams),
        -np.arange(columns) * 2 * np.pi / columns,
    )


def structured(ranges, elevation, azimuth, *, ring):
    dtype = [("x", "f4"), ("y", "f4"), ("z", "f4"), ("intensity", "f4"), ("time", "f4")]
    points = np.zeros(ranges.shape, np.dtype([*dtype, ("ring", "u2")] if ring else dtype))
    points["x"] = ranges * np.cos(elevation)[:, None] * np.cos(azimuth)
    points["y"] = ranges * np.cos(elevation)[:, None] * np.sin(azimuth)
    points["z"] = ranges * np.sin(elevation)[:, None]
    points["intensity"] = np.arange(ranges.size).reshape(ranges.shape) % 200
    points["time"] = np.linspace(0, 0.1, ranges.shape[1], endpoint=False)
    if ring:
        points["ring"] = np.arange(len(ranges))[:, None]
    return points


@pytest.mark.parametrize("layout", ["rows", "rings", "beam by beam"])
def test_a_cloud_becomes_a_scan_with_its_points_in_place(bag, layout):
    ranges, elevation, azimuth = spinning()
    points = structured(ranges, elevation, azimuth, ring=layout == "rings")
    sent = points.T if layout == "rings" else points  # with rings, column by column as it is fired
    with bag:
        height = len(ranges) if layout == "rows" else 1
        bag.put("/points", bag.cloud(START, points.dtype.names, sent.ravel(), height), START)
    (entry,) = open_bag(bag.path, []).entries()
    scan = entry.message
    assert entry.key == "sensor/lidar/top"
    np.testing.assert_allclose(scan.ranges, ranges, rtol=1e-5)
    np.testing.assert_allclose(scan.elevations, np.broadcast_to(elevation[:, None], ranges.shape), atol=1e-5)
    np.testing.assert_allclose(np.angle(np.exp(1j * (scan.azimuths - azimuth))), 0, atol=1e-5)
    np.testing.assert_allclose(scan.intensities, points["intensity"])
    np.testing.assert_allclose(scan.offsets, points["time"][0], atol=1e-6)


def test_a_cloud_without_rows_and_rings_is_refused(tmp_path):
    bag = Bag("mcap", tmp_path / "drive")
    points = structured(*spinning(), ring=False)
    with bag:
        mixed = np.random.default_rng(0).permutation(points.ravel())
        bag.put("/points", bag.cloud(START, points.dtype.names, mixed), START)
    with pytest.raises(RecordingError, match="neither rows nor rings"):
        list(open_bag(bag.path, []).entries())


@pytest.mark.parametrize("encoding", ["rgb8", "bgr8", "bayer_rggb8", "mono16"])
def test_every_encoding_is_brought_to_grey_or_rgb(tmp_path, encoding):
    colour = np.zeros((*SIZE, 3), np.uint8)
    colour[:] = (200, 120, 40)
    sent = {
        "rgb8": colour,
        "bgr8": colour[..., ::-1].copy(),
        "mono16": np.full(SIZE, 200 * 256 + 7, np.uint16),
    }.get(encoding)
    if sent is None:
        sent = np.full(SIZE, 120, np.uint8)
        sent[::2, ::2], sent[1::2, 1::2] = 200, 40
    bag = Bag("sqlite3", tmp_path / "drive")
    with bag:
        bag.put("/eye/image", bag.image(START, sent, encoding), START)
    (entry,) = open_bag(bag.path, parse_map(["/eye=sensor/camera/eye"])).entries()
    want = np.full(SIZE, 200) if encoding == "mono16" else colour
    np.testing.assert_array_equal(entry.message.image[2:-2, 2:-2], want[2:-2, 2:-2])


def test_raw_images_are_rectified_and_rectified_ones_are_not(tmp_path):
    """A grid of dots, moved as the lens does, comes back to where it was."""
    D = (-0.2, 0.03, 0.001, -0.001, 0.0)
    K = np.array([[FX, 0, 31.5], [0, FX, 23.5], [0, 0, 1]])
    grid = np.array([[x, y] for x in (16, 31, 46) for y in (12, 23, 35)], float)
    rays = np.column_stack([(grid - [31.5, 23.5]) / FX, np.ones(len(grid))])
    moved, _ = cv2.projectPoints(rays, np.zeros(3), np.zeros(3), K, np.array(D))
    image = np.zeros((SIZE[0] * 8, SIZE[1] * 8), np.float32)
    for u, v in moved[:, 0]:
        cv2.circle(image, (round(8 * u + 3.5), round(8 * v + 3.5)), 12, 255, -1)
    raw = cv2.resize(image, SIZE[::-1], interpolation=cv2.INTER_AREA).astype(np.uint8)
    bag = Bag("mcap", tmp_path / "drive")
    with bag:
        for side, name in enumerate(("left", "right")):
            bag.put(f"/{name}/camera_info", bag.info(START, right=bool(side), D=D), START)
            for kind in ("image_raw", "image_rect"):
                bag.put(f"/{name}/{kind}", bag.image(START, raw), START + 1)

    def frame(kind):
        wishes = [f"/{side}/{kind}=sensor/stereo/front.{side}" for side in ("left", "right")]
        return next(open_bag(bag.path, parse_map(wishes)).entries()).message

    np.testing.assert_array_equal(frame("image_rect").left, raw)
    left = frame("image_raw").left.astype(float)
    for x, y in grid.astype(int):
        window = left[y - 3 : y + 4, x - 3 : x + 4]
        v, u = np.mgrid[-3:4, -3:4]
        assert abs((window * u).sum() / window.sum() - 0.0) < 0.35
        assert abs((window * v).sum() / window.sum() - 0.0) < 0.35
    default = next(open_bag(bag.path, []).entries()).message
    np.testing.assert_array_equal(default.left, raw, err_msg="by itself the rectified pair is taken")


@pytest.mark.parametrize("part", [0.0, 0.3, 0.9])
def test_a_bag_that_was_cut_is_one_sentence(bag, part):
    path = write_stereo(bag)
    file = path if path.is_file() else next(f for f in path.iterdir() if f.name != "metadata.yaml")
    file.write_bytes(file.read_bytes()[: int(file.stat().st_size * part)])
    assert is_bag(path)
    with pytest.raises(RecordingError, match=str(path)):
        list(open_bag(path, []).entries())


def test_a_foreign_file_and_a_missing_one_are_one_sentence_each(tmp_path):
    file = tmp_path / "notes.txt"
    file.write_text("nothing")
    with pytest.raises(RecordingError, match="is no recording: give"):
        open_timeline(file, [], Names())
    with pytest.raises(RecordingError, match="there is no file or folder"):
        open_timeline(tmp_path / "nowhere", [], Names())
    fake = tmp_path / "fake.bag"
    fake.write_bytes(b"#ROSBAG V2.0\n" + bytes(500))
    with pytest.raises(RecordingError, match=r"fake\.bag"):
        open_timeline(fake, [], Names())


def test_an_mcap_of_another_kind_is_named(tmp_path):
    with (tmp_path / "other.mcap").open("wb") as stream:
        writer = McapWriter(stream)
        writer.start(profile="x-log")
        writer.finish()
    with pytest.raises(RecordingError, match=r"profile 'x-log', which cannot be played"):
        open_timeline(tmp_path / "other.mcap", [], Names())


def test_jackals_wheels_are_played(data_dir):
    recording = open_timeline(data_dir / "bags" / "jackal.bag", [], Names())
    assert recording.counts == {"sensor/odometry": 3060}
    entries = list(recording.entries())
    assert len(entries) == 3060
    assert np.median(np.diff([e.message.stamp for e in entries])) == pytest.approx(20 * MS, rel=0.01)
    assert max(e.message.v for e in entries) == pytest.approx(2.0, abs=0.2)
