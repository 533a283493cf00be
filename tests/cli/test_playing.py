"""What is played of which recording, when, and with which stamps and speeds."""

from __future__ import annotations

import itertools
import json

import numpy as np
import pytest

from cli import client, player
from cli.errors import CommandError
from cli.player import Part, Player
from cli.robot import load
from common import topics
from common.messages import Joystick, LidarScan, State, StateName, WheelOdometry, now_ns
from services.sensors.recordings.mcap import McapWriter, open_mcap
from services.sensors.recordings.mcap.writer import Origin
from services.sensors.recordings.opening import Names, open_timeline
from services.sensors.recordings.timeline import Entry
from tests.processes import Robot, eventually

COUNT = 20
STEP_NS = 10_000_000
START = 1_700_000_000_000_000_000
WHEELS, JOY = "sensor/odometry", "sensor/joystick"


@pytest.fixture
def robot(tmp_path):
    with Robot(tmp_path) as robot:
        yield robot


@pytest.fixture
def recorded(tmp_path):
    """A recording of wheels, a joystick and states, each message recorded 3 ms after its stamp."""
    with McapWriter(tmp_path / "bag", "r1", 10**9) as writer:
        for n in range(COUNT):
            stamp = START + n * STEP_NS
            state = State(stamp=stamp, name=StateName.IDLE, environment="park", since=1, reason="")
            for topic, message in (
                (topics.WHEEL_ODOMETRY, WheelOdometry(stamp=stamp, v=n, w=0.1)),
                (topics.JOYSTICK, Joystick(stamp=stamp, axes=[0.1], held=True)),
                (topics.STATE, state),
            ):
                writer.write(topic, topic.key, message, Origin("sensors", "a"), n, stamp + 3_000_000)
    return tmp_path / "bag"


class Sent:
    """A bus that keeps what a player puts on it."""

    def __init__(self):
        self.messages = []

    def subscribe(self, *_):
        return None

    def present(self):
        """Nobody looks."""

    def publisher(self, topic, name=""):
        return type("Publisher", (), {"put": lambda _, message: self.messages.append((topic, name, message))})()


def play(recording, **options):
    bus = Sent()
    played = Player(bus, recording, **options).play(lambda: None)
    return played, bus.messages


def test_only_what_sensors_said_is_played(recorded):
    played, sent = play(open_mcap(recorded), rate=10.0)
    assert played.messages == {WHEELS: COUNT, JOY: COUNT}
    assert {topic for topic, _, _ in sent} == {topics.WHEEL_ODOMETRY, topics.JOYSTICK}


def test_stamps_are_of_now_and_keep_their_delay(recorded):
    before = now_ns()
    _, sent = play(open_mcap(recorded), part=Part(keys=frozenset({WHEELS})))
    stamps = np.array([message.stamp for _, _, message in sent])
    earliest = before - 3_000_000 + np.arange(COUNT) * STEP_NS
    assert (stamps >= earliest - 1_000_000).all(), "a message came before it was due"
    assert (stamps <= now_ns() - 3_000_000).all()
    assert (np.diff(stamps) > 0).all()


def test_twice_as_fast_the_robot_drives_twice_as_fast(recorded):
    _, sent = play(open_mcap(recorded), rate=2.0, part=Part(keys=frozenset({WHEELS})))
    assert [message.v for _, _, message in sent] == [2.0 * n for n in range(COUNT)]
    scan = LidarScan(
        stamp=5,
        T_vehicle_lidar=np.eye(4),
        ranges=np.ones((2, 16), np.float32),
        intensities=np.ones((2, 16), np.uint8),
        elevations=np.zeros(2),
        azimuths=np.zeros(16),
        offsets=np.linspace(-0.1, 0, 16),
    )

    class One:
        name, start_ns, end_ns, counts = "one", 5, 5, {"sensor/lidar/top": 1}

        def entries(self, *_):
            return iter([Entry(5, topics.LIDAR, "top", scan)])

    _, ((_, _, message),) = play(One(), rate=4.0)
    np.testing.assert_allclose(message.offsets, np.linspace(-0.025, 0, 16))


def test_a_part_is_played(recorded):
    part = Part(start=0.05, duration=0.05, keys=frozenset({WHEELS}))
    _, sent = play(open_mcap(recorded), rate=10.0, part=part)
    assert [message.v for _, _, message in sent] == [50, 60, 70, 80, 90]


def test_a_loop_begins_again(recorded):
    bus, count = Sent(), itertools.count()

    def interrupt():
        if next(count) == 2 * COUNT + 4:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        Player(bus, open_mcap(recorded), 4.0, Part(keys=frozenset({WHEELS}))).play(interrupt, loop=True)
    assert [m.v for _, _, m in bus.messages] == [4.0 * (n % COUNT) for n in range(2 * COUNT + 5)]


def test_a_part_that_is_empty_is_refused(recorded):
    with pytest.raises(CommandError, match=r"0\.2 s long"):
        play(open_mcap(recorded), part=Part(start=9.0))
    with pytest.raises(CommandError, match=f"no 'sensor/lidar/top': it has {JOY}, {WHEELS}"):
        play(open_mcap(recorded), part=Part(keys=frozenset({"sensor/lidar/top"})))


def test_a_bag_reaches_a_live_bus(robot, data_dir):
    watcher = robot.bus("watcher")
    presence, wheels = watcher.presence(), watcher.subscribe(topics.WHEEL_ODOMETRY)
    eventually(lambda: "router" in presence, "the watcher is connected")
    recording = open_timeline(data_dir / "bags" / "jackal.bag", [], Names())
    with client.connect(load(robot.config), player.PROCESS) as bus:
        played = Player(bus, recording, 20.0, Part(start=20.0, duration=20.0)).play(lambda: None)
        assert played.messages == {WHEELS: 1000}
        last = eventually(wheels.last, "wheel odometry arrives")
    assert last.source.process == "player"
    assert abs(last.message.v) <= 20.0 * 2.1


def test_info_needs_no_robot(vtr, recorded):
    text = vtr("play", recorded, "--info")
    assert text.code == 0
    assert f"{WHEELS}: {COUNT} messages" in text.out
    figures = json.loads(vtr("play", recorded, "--info", "--json").out)
    assert figures["messages"] == {WHEELS: COUNT, JOY: COUNT}


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        (["--map", "/odom=sensor/odometry"], "is no ROS bag"),
        (["--frames", "0:3"], "by --start and --duration"),
        (["--topics", "sensor/lidar/top"], "the recording has no 'sensor/lidar/top'"),
        (["--start", "100"], "long"),
        (["--as", "teach", "--loop"], "--loop has no end"),
    ],
)
def test_options_that_do_not_fit_are_refused(vtr, recorded, write_config, options, sentence):
    result = vtr("play", recorded, *options, "--config", write_config())
    assert result.code == 1
    assert sentence in result.sentence


@pytest.mark.parametrize("content", [b"", b"\x89MCAP0\r\n", b"\x89MCAP0\r\n" + bytes(100), b"not a bag at all"])
@pytest.mark.parametrize("name", ["x.mcap", "x.bag", "x.db3", "x.pcap", "x.txt"])
def test_foreign_files_are_one_sentence(vtr, tmp_path, write_config, name, content):
    (tmp_path / name).write_bytes(content)
    result = vtr("play", tmp_path / name, "--config", write_config())
    assert result.code == 1
    assert name.removesuffix(".pcap") in result.sentence
