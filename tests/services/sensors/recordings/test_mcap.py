"""MCAP files of a robot's bus: complete to the bit, decodable by their schemas, and whole whatever ends the writer."""

from __future__ import annotations

import errno
import json
import os

import cv2
import jsonschema
import msgpack
import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

from common import topics, wire
from common.geometry import exp
from common.messages import CameraModel, LidarScan, StereoFrame, Truth, VelocityCommand
from common.topics import Delivery
from services.sensors.recordings import RecordingError
from services.sensors.recordings.mcap import McapWriter, is_mcap_recording, open_mcap
from services.sensors.recordings.mcap.encoding import Encoder, decode, encoding_of, schema_of
from services.sensors.recordings.mcap.writer import CHUNK_BYTES, Origin
from tests import fuzz

ORIGIN = Origin("sensors", "a1")
SECOND = 1_000_000_000
PUBLISHED = {t: m for t, m in fuzz.valid_examples().items() if t.delivery is not Delivery.QUERY}

every_published = pytest.mark.parametrize("topic", PUBLISHED, ids=lambda topic: topic.key)


def stereo(stamp, noise=0):
    rng = np.random.default_rng(noise)
    camera = CameraModel(
        width=96,
        height=64,
        fx=80.0,
        fy=80.0,
        cx=47.5,
        cy=31.5,
        baseline=0.2,
        T_vehicle_camera=exp([0.1, 0, 1, 0, 0.1, 0]),
    )
    left, right = rng.integers(0, 255, (2, 64, 96, 3), np.uint8)
    return StereoFrame(stamp=stamp, camera=camera, left=left, right=right)


def writer_in(folder, split=10**9, **options):
    return McapWriter(folder, "r1", split, **options)


def put(writer, topic, message, number, name="front"):
    writer.write(topic, topic.key.format(name=name), message, ORIGIN, number, SECOND + number)


def fill(writer, count, start=0):
    for number in range(start, start + count):
        put(writer, topics.TRUTH, Truth(stamp=number, T_world_vehicle=np.eye(4), v=number, w=0.0), number)


def speeds(path):
    return [found.entry.message.v for found in open_mcap(path).recorded()]


@every_published
def test_a_message_of_every_topic_comes_back_to_the_last_bit(topic):
    message = PUBLISHED[topic]
    again = decode(topic.message, Encoder().encode(message))
    assert wire.encode(again) == wire.encode(message)


@every_published
def test_what_is_written_obeys_the_schema_beside_it(topic):
    schema = json.loads(schema_of(topic.message))
    assert "$ref" not in str(schema)
    data = Encoder().encode(PUBLISHED[topic])
    if encoding_of(topic.message) == "json":
        jsonschema.Draft202012Validator(schema).validate(json.loads(data))
    else:
        as_text = msgpack.unpackb(data, object_hook=lambda d: d | {"data": "bytes"} if "data" in d else d)
        jsonschema.Draft202012Validator(schema).validate(as_text)
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.Draft202012Validator(schema).validate({"stamp": -1})


def test_floats_that_are_hard_to_print_come_back():
    values = np.random.default_rng(0).normal(size=6) * 10.0 ** np.array([-300, -9, -1, 0, 9, 300])
    twist = PUBLISHED[topics.ODOMETRY].model_copy(update={"twist": values})
    np.testing.assert_array_equal(decode(type(twist), Encoder().encode(twist)).twist, values)


def test_a_file_holds_every_message_and_its_views_and_all_decode(tmp_path):
    with writer_in(tmp_path, configuration="[robot]\n") as writer:
        for number, (topic, message) in enumerate(PUBLISHED.items()):
            put(writer, topic, message, number, name="front" if topic is not topics.HEALTH else "safety")
    recording = open_mcap(tmp_path)
    found = list(recording.recorded())
    assert [f.entry.topic for f in found] == list(PUBLISHED)
    assert [wire.encode(f.entry.message) for f in found] == [wire.encode(m) for m in PUBLISHED.values()]
    assert {f.process for f in found} == {"sensors"}
    assert [f.sequence for f in found] == list(range(len(PUBLISHED)))
    assert recording.configuration() == "[robot]\n"
    with writer.files[0].open("rb") as stream:
        names = set()
        for schema, channel, message in make_reader(stream, validate_crcs=True).iter_messages():
            if channel.message_encoding == "protobuf":
                DecoderFactory().decoder_for("protobuf", schema)(message.data)
            names.add(schema.name)
    assert names >= {
        f"foxglove.{name}"
        for name in ("CompressedImage", "CameraCalibration", "PointCloud", "PoseInFrame", "PosesInFrame", "Log")
    } | {"foxglove.FrameTransform"}


def views(path, topic):
    with path.open("rb") as stream:
        return [
            DecoderFactory().decoder_for("protobuf", schema)(message.data)
            for schema, _, message in make_reader(stream).iter_messages(topic)
        ]


def test_views_show_the_pixels_the_calibration_and_the_points(tmp_path):
    frame = stereo(5 * SECOND + 7)
    smooth = cv2.GaussianBlur(frame.left, (0, 0), 4)
    frame = frame.model_copy(update={"left": smooth})
    ranges = np.zeros((2, 16), np.float32)
    ranges[1, 3] = 5.0
    scan = LidarScan(
        stamp=1,
        T_vehicle_lidar=np.eye(4),
        ranges=ranges,
        intensities=np.full((2, 16), 9, np.uint8),
        elevations=np.array([0.2, 0.0]),
        azimuths=np.linspace(0, 3, 16),
        offsets=np.zeros(16),
    )
    with writer_in(tmp_path) as writer:
        put(writer, topics.STEREO, frame, 0)
        put(writer, topics.LIDAR, scan, 1, "top")
    (picture,) = views(writer.files[0], "/view/sensor/stereo/front/left")
    assert (picture.timestamp.seconds, picture.timestamp.nanos) == (5, 7)
    shown = cv2.cvtColor(cv2.imdecode(np.frombuffer(picture.data, np.uint8), cv2.IMREAD_COLOR), cv2.COLOR_BGR2RGB)
    assert np.abs(shown.astype(int) - smooth).mean() < 4
    (right,) = views(writer.files[0], "/view/sensor/stereo/front/right/calibration")
    assert right.P[3] == pytest.approx(-80.0 * 0.2)
    (cloud,) = views(writer.files[0], "/view/sensor/lidar/top")
    np.testing.assert_allclose(
        np.frombuffer(cloud.data, np.float32), [5 * np.cos(0.6), 5 * np.sin(0.6), 0.0, 9.0], atol=1e-5
    )


@pytest.mark.parametrize("rotation", [[0, 0, 0], [0, 0, 3.14159], [2.2, -2.2, 0], [1e-9, 0, 0], [0.3, -0.2, 1.0]])
def test_a_viewed_pose_is_the_pose(tmp_path, rotation):
    T = exp([1.0, 2.0, 3.0, *rotation])
    with writer_in(tmp_path) as writer:
        put(writer, topics.TRUTH, Truth(stamp=1, T_world_vehicle=T, v=0, w=0), 0)
    (view,) = views(writer.files[0], "/view/truth/pose")
    q = view.pose.orientation
    v = np.array([q.x, q.y, q.z])
    R = (q.w**2 - v @ v) * np.eye(3) + 2 * np.outer(v, v) + 2 * q.w * np.cross(np.eye(3), v)
    np.testing.assert_allclose(R, T[:3, :3], atol=1e-9)
    np.testing.assert_allclose([view.pose.position.x, view.pose.position.y, view.pose.position.z], T[:3, 3])


def test_the_file_is_whole_after_every_flush_and_while_chunks_are_written(tmp_path):
    writer = writer_in(tmp_path)
    assert writer.files[0].stat().st_size > 0
    big = stereo(0)
    for number in range(2 * CHUNK_BYTES // big.left.nbytes):
        put(writer, topics.STEREO, big, number)
        with writer.files[0].open("rb") as stream:
            read = sum(1 for _ in make_reader(stream, validate_crcs=True).iter_messages("/sensor/stereo/front"))
        assert number + 1 - read <= 1 + CHUNK_BYTES // (2 * big.left.nbytes)
    put(writer, topics.SAFE, VelocityCommand(stamp=1, v=1, w=0), number + 1)
    writer.flush()
    recording = open_mcap(tmp_path)
    assert not recording.whole
    assert recording.all_counts == {"command/safe": 1, "sensor/stereo/front": number + 1}


def test_a_file_that_was_cut_anywhere_tells_what_came_before(tmp_path):
    with writer_in(tmp_path / "a") as writer:
        for first in range(0, 40, 10):
            fill(writer, 10, first)
            writer.flush()
    whole = writer.files[0].read_bytes()
    seen = set()
    for size in range(len(whole) // 3, len(whole), 401):
        cut = tmp_path / "cut.mcap"
        cut.write_bytes(whole[:size])
        try:
            found = speeds(cut)
        except RecordingError:
            found = []
        assert found == list(range(len(found)))
        assert len(found) % 10 == 0
        seen.add(len(found))
    assert {10, 20, 30, 40} <= seen


def test_files_are_split_by_size_and_read_as_one(tmp_path):
    with writer_in(tmp_path, split=1_000_000) as writer:
        for number in range(120):
            put(writer, topics.STEREO, stereo(number * SECOND, number), number)
    assert len(writer.files) >= 3
    assert all(file.stat().st_size < 2_100_000 + CHUNK_BYTES for file in writer.files)
    entries = list(open_mcap(tmp_path).entries())
    assert [entry.message.stamp for entry in entries] == [n * SECOND for n in range(120)]
    assert open_mcap(writer.files[1]).counts["sensor/stereo/front"] < 60
    assert [e.time_ns for e in open_mcap(tmp_path).entries(SECOND + 10, SECOND + 13)] == [
        SECOND + n for n in (10, 11, 12)
    ]


def test_a_full_disk_keeps_what_was_recorded(tmp_path, monkeypatch):
    writer = writer_in(tmp_path)
    fill(writer, 10)
    writer.flush()
    fill(writer, 10, 10)
    original = os.pwritev

    def full(descriptor, pieces, position):
        original(descriptor, [bytes(pieces[0])[:100]], position)
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "pwritev", full)
    with pytest.raises(RecordingError, match=r"No space left on device.*make room"):
        writer.flush()
    writer.close()
    assert speeds(tmp_path) == list(range(10))
    with writer.files[0].open("rb") as stream:
        assert sum(1 for _ in make_reader(stream).iter_messages("/truth/pose")) == 10


def test_what_is_no_recording_is_told_from_one(tmp_path):
    other = tmp_path / "other.mcap"
    other.write_bytes(b"\x89MCAP0\r\n" + bytes(50))
    assert not is_mcap_recording(other)
    assert not is_mcap_recording(tmp_path / "missing")
    with pytest.raises(RecordingError, match="no recording of vtr record"):
        open_mcap(other)
    with writer_in(tmp_path / "empty"):
        pass
    with pytest.raises(RecordingError, match="no message"):
        open_mcap(tmp_path / "empty")


def test_damage_in_the_middle_is_one_sentence(tmp_path):
    with writer_in(tmp_path) as writer:
        fill(writer, 100)
    data = bytearray(writer.files[0].read_bytes())
    place = data.index(b'"v":50')
    data[place : place + 6] = b'"v":99'
    writer.files[0].write_bytes(data)
    with pytest.raises(RecordingError, match="damaged"):
        speeds(tmp_path)


def test_two_recordings_in_a_folder_are_not_mixed(tmp_path):
    for robot in ("r1", "r2"):
        with McapWriter(tmp_path, robot, 10**9) as writer:
            fill(writer, 3)
    with pytest.raises(RecordingError, match="2 recordings"):
        open_mcap(tmp_path)


def test_a_folder_that_cannot_be_written_is_one_sentence(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(RecordingError, match="choose another folder"):
        writer_in(tmp_path / "file")
