"""``vtr record`` as its own process on a live bus: nothing is lost, and what it wrote outlives ``kill -9``."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
import sys
import threading
import time

import numpy as np
import pytest
from mcap.reader import make_reader

from cli import recorder
from cli.errors import CommandError
from common import topics
from common.messages import CameraModel, State, StateName, StereoFrame, Truth, now_ns
from services.sensors.recordings.mcap import open_mcap
from tests.processes import ROOT, Robot, eventually

CAMERA = CameraModel(
    width=320, height=200, fx=250.0, fy=250.0, cx=159.5, cy=99.5, baseline=0.2, T_vehicle_camera=np.eye(4)
)


@pytest.fixture
def robot(tmp_path):
    with Robot(tmp_path) as robot:
        yield robot


@contextlib.contextmanager
def recording(robot, folder, *options):
    """``vtr record`` once it hears the bus."""
    command = [sys.executable, "-m", "cli", "record", "-o", str(folder), "--config", str(robot.config), "--json"]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    process = subprocess.Popen(
        [*command, *options], cwd=ROOT, env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    try:
        eventually(lambda: list(folder.glob("*.mcap")), "a file is there", 30.0)
        yield process
    finally:
        process.kill()
        process.communicate()


class Sensors:
    """Publishes numbered frames and truths as the sensors do."""

    def __init__(self, robot):
        self._bus = robot.bus("sensors")
        self._frames = self._bus.publisher(topics.STEREO, "front")
        self._truth = self._bus.publisher(topics.TRUTH)
        self.sent = 0

    def send(self, count, period=0.02):
        image = np.random.default_rng(0).integers(0, 255, (200, 320, 3), np.uint8)
        for _ in range(count):
            if self.sent % 5 == 0:
                self._frames.put(StereoFrame(stamp=now_ns(), camera=CAMERA, left=image, right=image))
            self._truth.put(Truth(stamp=now_ns(), T_world_vehicle=np.eye(4), v=self.sent, w=0.0))
            self.sent += 1
            time.sleep(period)


def heard(folder):
    """Numbers of the truths that a reader of any make finds."""
    numbers = []
    for file in sorted(folder.glob("*.mcap")):
        with file.open("rb") as stream:
            found = make_reader(stream, validate_crcs=True).iter_messages("/truth/pose")
            numbers += [int(json.loads(message.data)["v"]) for _, _, message in found]
    return numbers


def until_heard(sensors, folder):
    """Sends until the recorder has written something: a session takes a moment until its samples reach all."""

    def some():
        sensors.send(5)
        return heard(folder)

    eventually(some, "something is recorded", 20.0)


def test_everything_that_was_sent_is_there_and_the_summary_says_so(robot, tmp_path):
    folder, sensors, navigator = tmp_path / "bag", Sensors(robot), robot.bus("navigator")
    state = State(stamp=1, name=StateName.IDLE, environment="park", since=1, reason="as it was before")
    states = navigator.publisher(topics.STATE)
    states.put(state)
    with recording(robot, folder, "--split-size", "2") as process:
        until_heard(sensors, folder)
        sensors.send(150)
        process.send_signal(signal.SIGINT)
        out, err = process.communicate(timeout=20)
    assert process.returncode == 0, err
    answer = json.loads(out)
    numbers = heard(folder)
    assert numbers == list(range(numbers[0], sensors.sent))
    assert answer["lost"] == answer["refused"] == {}
    assert answer["messages"]["truth/pose"] == len(numbers)
    assert len(answer["files"]) > 2
    stored = open_mcap(folder)
    assert stored.whole
    assert stored.all_counts == answer["messages"]
    (found,) = stored.recorded(["state"])
    assert found.entry.message == state


def test_what_was_recorded_outlives_kill_9(robot, tmp_path):
    folder, sensors = tmp_path / "bag", Sensors(robot)
    with recording(robot, folder) as process:
        until_heard(sensors, folder)
        for _ in range(4):
            before = sensors.sent
            sensors.send(40)
            time.sleep(1.3)
            process.poll()
            assert heard(folder)[-1] >= before, "what is older than the last flush is readable at any time"
        stop = threading.Event()
        sending = threading.Thread(target=lambda: [sensors.send(20) for _ in iter(stop.is_set, True)])
        sending.start()
        time.sleep(0.4)
        process.kill()
        process.wait()
        stop.set()
        sending.join()
    numbers = heard(folder)
    assert numbers == list(range(numbers[0], numbers[-1] + 1))
    assert numbers[-1] >= before
    stored = open_mcap(folder)
    assert not stored.whole
    assert len(list(stored.recorded(["truth/pose"]))) == len(numbers)
    assert stored.counts["sensor/stereo/front"] == len(list(stored.entries()))


def test_chosen_topics_alone_are_recorded_and_a_time_ends_it(robot, tmp_path):
    folder, sensors = tmp_path / "bag", Sensors(robot)
    with recording(robot, folder, "--topics", "truth/pose,state", "--duration", "2.5") as process:
        while process.poll() is None:
            sensors.send(10)
        answer = json.loads(process.communicate()[0])
    assert set(answer["messages"]) == {"truth/pose"}


def test_a_topic_that_does_not_exist_is_named():
    assert recorder.choose(["sensor/stereo/front"]) == [(topics.STEREO, "front")]
    assert recorder.choose(["health", "sensor/stereo"]) == [(topics.HEALTH, "*"), (topics.STEREO, "*")]
    assert (topics.SAFE, "*") in recorder.choose([])
    with pytest.raises(CommandError, match="there is no topic 'sensor/radar'"):
        recorder.choose(["sensor/radar"])


def test_what_cannot_be_recorded_is_one_sentence(vtr, write_config, tmp_path):
    missing = vtr("record", "-o", tmp_path, "--config", write_config())
    assert missing.code == 1
    assert "is the robot up?" in missing.sentence
    wrong = vtr("record", "--topics", "sensor/radar", "--config", write_config())
    assert (wrong.code, "there is no topic 'sensor/radar'" in wrong.sentence) == (1, True)


def test_a_folder_that_cannot_be_made_is_one_sentence(vtr, robot, tmp_path):
    (tmp_path / "file").write_text("")
    result = vtr("record", "-o", tmp_path / "file" / "below", "--config", robot.config)
    assert result.code == 1
    assert "choose another folder" in result.sentence
