"""A run that was recorded gives the same poses again, and where two runs part is told."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time

import cv2
import numpy as np
import pytest

from cli.replay import compare, run
from cli.replay.inputs import inputs
from common import topics
from common.geometry import exp
from common.ids import new_map_id
from common.messages import (
    CameraFrame,
    CameraModel,
    MapRecord,
    Odometry,
    State,
    StateName,
    StereoFrame,
    WheelOdometry,
    now_ns,
)
from services.sensors.recordings.mcap import McapWriter, open_mcap
from services.sensors.recordings.mcap.writer import Origin
from services.sensors.recordings.timeline import Entry
from tests.processes import ROOT, Robot, eventually
from tests.services.estimator.stereo.scene import CAMERA, render

FRAMES = 25
PERIOD_S = 0.2
SPEED = 0.6
SECOND = 1_000_000_000

TABLES = """
[estimator.stereo.bundle]
enabled = false
"""
"""The bundle adjustment runs beside the frames: when its outcome is taken up depends on the machine's load."""


def poses(count):
    step = exp([0.0, 0.0, SPEED * PERIOD_S, 0.0, 0.01, 0.0])
    T = [np.eye(4)]
    for _ in range(count - 1):
        T.append(T[-1] @ step)
    return T


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """The estimator as a live process on rendered frames, while a map is taught; recorded by ``vtr record``."""
    folder = tmp_path_factory.mktemp("live")
    pairs = [render(T, CAMERA) for T in poses(FRAMES)]
    model = CameraModel.of(CAMERA)
    with Robot(folder, TABLES) as robot:
        robot.start("mapstore")
        robot.start("estimator")
        sensors, navigator = robot.act_as("sensors"), robot.act_as("navigator")
        frames, wheels = sensors.publisher(topics.STEREO, "front"), sensors.publisher(topics.WHEEL_ODOMETRY)
        states, odometry = navigator.publisher(topics.STATE), navigator.subscribe(topics.ODOMETRY)
        record = MapRecord(id=new_map_id("r1", now_ns()), environment="default", stamp=1, robot="r1", sensor="stereo")
        command = [sys.executable, "-m", "cli", "record", "-o", str(folder / "bag"), "--config", str(robot.config)]
        process = subprocess.Popen(command, cwd=ROOT, env={**os.environ, "PYTHONPATH": str(ROOT)})
        eventually(lambda: list((folder / "bag").glob("*.mcap")), "a file is there", 30.0)
        time.sleep(1.0)

        def show(name, kept=None):
            states.put(State(stamp=now_ns(), name=name, environment="default", since=1, reason="", map=kept))

        show(StateName.TEACH_BRANCH, record)
        time.sleep(0.2)
        for left, right in pairs:
            stamp = now_ns()
            wheels.put(WheelOdometry(stamp=stamp, v=SPEED, w=0.0))
            time.sleep(0.02)
            frames.put(StereoFrame(stamp=stamp, camera=model, left=left, right=right))
            # As a robot's frames do, the next one waits for its time; a slow machine gets longer.
            eventually(lambda stamp=stamp: _answered(odometry, stamp), "the estimator answers", 60.0)
            time.sleep(0.1)
        process.send_signal(signal.SIGINT)
        assert process.wait(20) == 0
    return open_mcap(folder / "bag")


def _answered(odometry, stamp):
    received = odometry.last()
    return received is not None and received.message.stamp == stamp


def again(recording, folder=None):
    with run.recorded_configuration(recording, None) as configuration:
        replayed = run.replay(recording, configuration, None, lambda: None)
        if folder is not None:
            run.write(replayed, folder, configuration)
    return replayed


def test_the_same_frames_give_the_same_poses_offline(recorded):
    live = [found.entry for found in recorded.recorded(["odometry"])]
    replayed = [entry for entry in again(recorded) if entry.topic is topics.ODOMETRY]
    assert len(live) == FRAMES
    assert [e.message.stamp for e in replayed] == [e.message.stamp for e in live]
    for then, now in zip(live, replayed, strict=True):
        np.testing.assert_allclose(now.message.T_vertex_robot, then.message.T_vertex_robot, atol=1e-9)
        np.testing.assert_allclose(now.message.covariance, then.message.covariance, rtol=1e-6, atol=1e-12)
        assert (now.message.vertex, now.message.inliers) == (then.message.vertex, then.message.inliers)
    assert sum(e.message.success for e in live) >= FRAMES - 1
    assert len({e.message.vertex for e in live}) > 4, "vertices were made on the way"
    assert compare.compare(live, replayed, 1e-9).agree


def test_with_bundle_adjustment_a_replay_is_the_same_each_time(recorded, tmp_path):
    """What the adjustment says is taken up at the same frames, whatever the machine's load."""
    settings = tmp_path / "with.toml"
    settings.write_text(recorded.configuration().replace("enabled = false", "enabled = true"), encoding="utf-8")
    with run.recorded_configuration(recorded, settings) as configuration:
        runs = [run.replay(recorded, configuration, None, lambda: None) for _ in range(2)]
    assert len(runs[0]) == FRAMES
    assert compare.compare(*runs, 0.0).agree
    assert not compare.compare(again(recorded), runs[0], 1e-6).agree, "the adjustment does something"


def test_a_replay_by_bearing_is_the_same_each_time(tmp_path):
    """A camera of which nothing is known passes a wall while a map is taught."""
    wall = cv2.GaussianBlur(np.random.default_rng(0).integers(0, 255, (120, 640), np.uint8), (0, 0), 2)
    configuration = f'[robot]\nname = "r1"\nsensor = "bearing"\ndirectory = "{tmp_path}"\n'
    record = MapRecord(id=new_map_id("r1", SECOND), environment="default", stamp=1, robot="r1", sensor="bearing")
    sensors = Origin("sensors", "a")
    with McapWriter(tmp_path / "bag", "r1", 10**9, configuration) as writer:
        for n in range(20):
            at = SECOND * 100 + n * SECOND // 10
            state = State(stamp=at, name=StateName.TEACH_BRANCH, environment="default", since=1, reason="", map=record)
            writer.write(topics.STATE, "state", state, Origin("navigator", "a"), n, at)
            wheels = WheelOdometry(stamp=at, v=SPEED, w=0.0)
            writer.write(topics.WHEEL_ODOMETRY, "sensor/odometry", wheels, sensors, n, at + 1)
            frame = CameraFrame(stamp=at, image=np.ascontiguousarray(wall[:, 8 * n : 8 * n + 320]))
            writer.write(topics.CAMERA, "sensor/camera/front", frame, sensors, n, at + 2)
    recording = open_mcap(tmp_path / "bag")
    runs = again(recording), again(recording)
    driven = [entry.message for entry in runs[0] if entry.topic is topics.ODOMETRY]
    assert len(driven) == 20
    assert len({message.vertex for message in driven}) > 2
    assert compare.compare(*runs, 0.0).agree


def test_a_frame_is_replayed_with_the_wheels_report_that_it_was_taken_with(tmp_path):
    """Whatever order the recorder heard them in; a frame whose report was stale has none now."""
    sensors, estimator, zeros = Origin("sensors", "a"), Origin("estimator", "b"), np.zeros((6, 6))
    with McapWriter(tmp_path, "r1", 10**9) as writer:
        for n, taken in enumerate((None, SECOND + 7, None)):
            at = SECOND * (n + 1)
            frame = CameraFrame(stamp=at, image=np.zeros((32, 32), np.uint8))
            writer.write(topics.CAMERA, "sensor/camera/front", frame, sensors, n, at)
            wheels = WheelOdometry(stamp=at + 7, v=float(n), w=0.0)
            writer.write(topics.WHEEL_ODOMETRY, "sensor/odometry", wheels, sensors, n, at + SECOND // 2)
            said = Odometry(
                stamp=at, vertex=None, T_vertex_robot=np.eye(4), covariance=zeros, twist=zeros[0], success=True,
                inliers=9, wheels=taken,
            )  # fmt: skip
            writer.write(topics.ODOMETRY, "odometry", said, estimator, n, at + SECOND // 4)
    given = list(inputs(open_mcap(tmp_path), "sensor/camera/front", lambda: None))
    assert [entry.key for entry in given] == ["sensor/odometry", "sensor/camera/front"] * 3
    fresh = [given[k + 1].time_ns - given[k].time_ns < SECOND // 10 for k in (0, 2, 4)]
    assert fresh == [False, True, False]
    assert given[2].message.stamp == SECOND + 7


def test_replay_diff_says_that_they_agree(vtr, recorded, tmp_path):
    result = vtr("replay-diff", recorded.files[0], "-o", tmp_path / "again", "--json")
    assert result.code == 0, result.err
    report = json.loads(result.out)
    assert report["agree"]
    assert report["topics"]["odometry"]["both"] == FRAMES
    kept = vtr("replay-diff", recorded.files[0], tmp_path / "again")
    assert (kept.code, "no difference beyond" in kept.out) == (0, True)


def test_other_settings_part_where_they_matter(vtr, recorded, tmp_path):
    other = tmp_path / "other.toml"
    other.write_text(recorded.configuration() + "[estimator.stereo.vertex_creation]\ndistance = 0.7\n")
    result = vtr("replay-diff", recorded.files[0], "--config", other, "--json")
    assert result.code == 4
    first = json.loads(result.out)["first"]
    assert first["topic"] == "odometry"
    text = vtr("replay-diff", recorded.files[0], "--config", other)
    assert f"odometry, stamp {first['stamp']}" in text.out


def odometry(stamp, x=0.0, **fields):
    T = exp([x, 0, 0, 0, 0, 0])
    zeros = np.zeros((6, 6))
    made = {"T_vertex_robot": T, "covariance": zeros, "twist": zeros[0], "success": True, "inliers": 9} | fields
    return Entry(stamp, topics.ODOMETRY, "", Odometry(stamp=stamp, vertex=None, **made))


def test_the_first_difference_and_the_largest_are_told():
    a = [odometry(SECOND * n) for n in range(5)]
    b = [odometry(SECOND * n, x=0.0 if n < 2 else 0.01 * n, inliers=9 + (n == 3)) for n in range(5)]
    report = compare.compare(a, b, 1e-6)
    assert (report.first.stamp, report.first.seconds, report.first.field) == (2 * SECOND, 2.0, "T_vertex_robot")
    moved = report.topics["odometry"].fields["T_vertex_robot [m]"]
    assert (moved.largest, moved.stamp, moved.count) == (pytest.approx(0.04), 4 * SECOND, 3)
    assert report.topics["odometry"].fields["inliers"].count == 1
    assert compare.compare(a, b, 1.0).agree


def test_a_missing_message_is_a_difference():
    a = [odometry(SECOND * n) for n in range(5)]
    report = compare.compare(a, a[:2] + a[3:], 1e-6)
    assert (report.first.stamp, report.first.first, report.first.second) == (2 * SECOND, "there", "missing")
    assert report.topics["odometry"].only_first == 1


def test_what_cannot_be_replayed_is_one_sentence(vtr, tmp_path):
    with McapWriter(tmp_path / "bag", "r1", 10**9) as writer:
        entry = odometry(SECOND)
        writer.write(entry.topic, entry.key, entry.message, Origin("estimator", "a"), 0, SECOND)
    (file,) = writer.files
    assert "holds no configuration" in vtr("replay-diff", file).sentence
    (tmp_path / "r1.toml").write_text('[robot]\nname = "r1"\n')
    assert "has no sensor/stereo/front" in vtr("replay-diff", file, "--config", tmp_path / "r1.toml").sentence
    assert "there is no recording" in vtr("replay-diff", tmp_path / "nothing.mcap").sentence
    assert "is not in both" in vtr("replay-diff", file, file, "--topics", "localization").sentence
    assert vtr("replay-diff", file, file).code == 0


def test_fields_that_are_left_out_do_not_count(vtr, tmp_path):
    files = []
    for folder, inliers in (("a", 9), ("b", 11)):
        with McapWriter(tmp_path / folder, "r1", 10**9) as writer:
            entry = odometry(SECOND, inliers=inliers)
            writer.write(entry.topic, entry.key, entry.message, Origin("estimator", "a"), 0, SECOND)
        files += writer.files
    assert vtr("replay-diff", *files).code == 4
    assert vtr("replay-diff", *files, "--ignore", "inliers").code == 0
