"""The player: every frame reaches the bus in the sensors' place, and a teach loses none."""

import threading

import numpy as np
import pytest

from cli import client, player
from cli.errors import CommandError
from cli.robot import load
from common import topics
from common.camera import StereoCamera
from common.ids import VertexId, new_map_id
from common.messages import Command, Done, MapRecord, Odometry, State, StateName, now_ns
from services.sensors.recordings import RecordingError, StereoPair
from services.sensors.recordings.timeline import StereoTimeline
from tests.processes import Robot, eventually

FRAMES = 7


class Drive:
    """A recording in memory; the left image's first pixel tells the frame."""

    name = "drive"
    camera = StereoCamera(64, 48, 60.0, 60.0, 32.0, 24.0, 0.1, np.eye(4))
    stamps_ns = np.arange(FRAMES, dtype=np.int64) * 1_000_000

    def __len__(self):
        return FRAMES

    def __getitem__(self, index):
        image = np.full((48, 64), index, np.uint8)
        return StereoPair(int(self.stamps_ns[index]), image, image)

    def __iter__(self):
        return (self[index] for index in range(FRAMES))


class Fakes:
    """A navigator that teaches at once, and an estimator that uses every frame it sees."""

    def __init__(self, robot):
        self.navigator, estimator = robot.act_as("navigator"), robot.act_as("estimator")
        self.commands, self.used, self.silent = [], [], False
        self._states = self.navigator.publisher(topics.STATE)
        self._frames = estimator.subscribe(topics.STEREO, "front")
        self._odometry = estimator.publisher(topics.ODOMETRY)
        self._stop = threading.Event()
        self.teaches_in = StateName.TEACH_BRANCH
        self.navigator.serve(topics.MISSION, self._answer)
        self.show(StateName.IDLE)
        self._thread = threading.Thread(target=self._estimate)
        self._thread.start()

    def close(self):
        self._stop.set()
        self._thread.join()

    def show(self, name, **fields):
        stamp = now_ns()
        self._states.put(State(stamp=stamp, name=name, environment="default", since=stamp, reason="", **fields))

    def _answer(self, command):
        self.commands.append(command.action)
        if command.action == "teach":
            record = MapRecord(id=new_map_id("r1", 0), environment="default", stamp=0, robot="r1", sensor="stereo")
            self.show(self.teaches_in, map=record, target=VertexId(record.id, 4))
        else:
            self.show(StateName.IDLE)
        return Done(text=f"{command.action} done")

    def _estimate(self):
        while not self._stop.is_set():
            received = self._frames.wait(0.05)
            if received is None:
                continue
            self.used.append(int(received.message.left[0, 0]))
            if not self.silent:
                self._odometry.put(_odometry(received.message.stamp))


def _odometry(stamp):
    zeros = np.zeros((6, 6))
    return Odometry(
        stamp=stamp, vertex=None, T_vertex_robot=np.eye(4), covariance=zeros, twist=zeros[0], success=True, inliers=9
    )


@pytest.fixture
def robot(tmp_path):
    with Robot(tmp_path) as robot:
        yield robot


@pytest.fixture
def fakes(robot):
    made = Fakes(robot)
    yield made
    made.close()


class Torn(Drive):
    """A recording one of whose images cannot be read."""

    def __getitem__(self, index):
        if index == 4:
            raise RecordingError("the image 4 is truncated")
        return super().__getitem__(index)


def _play(robot, role, rate=50.0, drive=Drive):
    with client.connect(load(robot.config), player.PROCESS) as bus:
        made = player.Player(bus, StereoTimeline(drive(), "front"), rate)
        if role == "teach":
            return made.teach(Command(action="teach"), "sensor/stereo/front", lambda: None)
        return made.play(lambda: None)


def test_a_taught_recording_is_used_frame_by_frame_and_finished(robot, fakes):
    played = _play(robot, "teach")
    assert fakes.used == [0, *range(FRAMES)]
    assert fakes.commands == ["teach", "finish"]
    assert played.messages == {"sensor/stereo/front": FRAMES}
    assert played.text == "finish done"


def test_an_estimator_that_does_not_answer_begins_no_map(robot, fakes, monkeypatch):
    monkeypatch.setattr(player, "_FIRST_ANSWER_S", 0.3)
    fakes.silent = True
    with pytest.raises(CommandError, match="frame 0"):
        _play(robot, "teach")
    assert fakes.commands == []


def test_an_image_that_cannot_be_read_begins_no_map(robot, fakes):
    with pytest.raises(RecordingError, match="truncated"):
        _play(robot, "teach", drive=Torn)
    assert fakes.commands == []
    assert fakes.used == []


def test_a_frame_that_was_dropped_is_played_again(robot, fakes, monkeypatch):
    monkeypatch.setattr(player, "_AGAIN_S", 0.2)
    original, seen = fakes._odometry.put, []

    def lose_the_first_answer_to_three(message):
        seen.append(fakes.used[-1])
        if seen.count(3) != 1 or seen[-1] != 3:
            original(message)

    fakes._odometry.put = lose_the_first_answer_to_three
    played = _play(robot, "teach")
    assert played.messages == {"sensor/stereo/front": FRAMES}
    assert fakes.used.count(3) >= 2
    assert fakes.commands == ["teach", "finish"]


def test_a_teach_that_somebody_pauses_is_ended_as_it_stands(robot, fakes):
    original = fakes._odometry.put

    def pause_at_three(message):
        if fakes.used[-1] == 3:
            fakes.show(StateName.PAUSED, resumes=StateName.TEACH_BRANCH)
        original(message)

    fakes._odometry.put = pause_at_three
    with pytest.raises(CommandError, match="interrupted"):
        _play(robot, "teach")
    assert fakes.commands == ["teach", "cancel"]
    assert max(fakes.used) < FRAMES - 1


def test_a_robot_that_would_localize_first_is_left_as_it_was(robot, fakes):
    fakes.teaches_in = StateName.TEACH_METRIC_LOCALIZE
    with pytest.raises(CommandError, match="--environment"):
        _play(robot, "teach")
    assert fakes.commands == ["teach", "cancel"]
    assert fakes.used == [0]


def test_without_a_teach_frames_are_published_whoever_listens(robot):
    watcher = robot.bus("watcher")
    presence = watcher.presence()
    frames = watcher.subscribe(topics.STEREO, "front")
    eventually(lambda: "router" in presence, "the watcher is connected")
    played = _play(robot, None, rate=0.05)
    assert played.messages == {"sensor/stereo/front": FRAMES}

    def last():
        received = frames.last()
        return None if received is None or received.message.left[0, 0] != FRAMES - 1 else received.message

    assert eventually(last, "the last frame arrived").camera.baseline == 0.1
