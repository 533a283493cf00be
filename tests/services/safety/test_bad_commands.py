"""What no sender may make the robot do: every sample here is put on the bus as it is, past all that a sender checks."""

import contextlib
import math
import os
import signal
import time

import pytest
import zenoh

from common import topics, wire
from common.bus import Bus
from common.bus.envelope import Envelope, Source
from common.messages import StateName, VelocityCommand, now_ns
from tests.processes import Robot, eventually, every
from tests.services.safety.crew import Crew

KEY = topics.DESIRED.at("r1")


class Tape:
    """The tracker's samples as they were on the bus."""

    def __init__(self, bus: Bus):
        self.samples = []
        self._subscriber = bus.session.declare_subscriber(KEY, self._keep)

    def _keep(self, sample: zenoh.Sample):
        self.samples.append((sample.payload.to_bytes(), sample.attachment.to_bytes()))


@pytest.fixture(scope="module")
def crew(tmp_path_factory):
    with Robot(tmp_path_factory.mktemp("robot")) as robot:
        crew = Crew(robot)
        crew.safety = robot.start("safety")
        crew.tape = Tape(robot.bus("stranger"))
        crew.former = recorded_former_life(robot, crew.tape)
        with every(0.03, crew.publish):
            yield crew


def recorded_former_life(robot, tape):
    """Samples of a life of the tracker that has ended."""
    with Bus(robot.name, "tracker", robot.endpoint, shared_memory=False) as bus:
        publisher = bus.publisher(topics.DESIRED)
        for _ in range(20):
            publisher.put(VelocityCommand(stamp=now_ns(), v=0.3, w=0.0))
        eventually(lambda: len(tape.samples) >= 20, "the samples are recorded")
    return list(tape.samples)


@pytest.fixture
def hung(crew):
    """The robot has followed the tracker, which is now there and silent; everything else is as it should be."""
    with crew.state_is(StateName.REPEAT_FOLLOW):
        crew.until(lambda safe: safe.v > 0.3, "the robot drives")
        with crew.silent_tracker():
            yield crew
            _, rules = crew.until_status(lambda status: not status.passing, "a status")
            assert rules <= {"command_stale", "command_invalid"}
        crew.until(lambda safe: safe.v > 0.3, "a sound command passes as before")


def keep_putting(crew, samples):
    """Puts samples on the tracker's key, ten times as often as it would, until the end of the block."""
    session = crew.robot.bus("stranger").session
    waiting = iter(samples)

    def put():
        with contextlib.suppress(StopIteration):
            payload, attachment = next(waiting)
            session.put(KEY, payload, attachment=attachment)

    return every(0.003, put)


def sealed(command, source, first=1):
    """The same command again and again, in sequence, as the source would send it."""
    payload = wire.encode(command)
    return [(payload, Envelope.seal(payload, source, first + i, command.stamp).pack()) for i in range(400)]


def command(v, w=0.0):
    return VelocityCommand.model_construct(stamp=now_ns(), v=v, w=w, frame_stamp=77)


@pytest.mark.parametrize(
    ("v", "w"),
    [(math.nan, 0.0), (0.3, math.nan), (math.inf, 0.0), (0.3, -math.inf), (1e308, 0.0), (-1e300, 1e300), (0.3, 50.0)],
)
def test_the_trackers_own_command_that_is_not_finite_or_huge(hung, v, w):
    with every(0.01, lambda: hung.desired.put(command(v, w))):
        assert hung.stands()


@pytest.mark.filterwarnings("ignore:Pydantic serializer warnings")
@pytest.mark.parametrize("v", ["fast", None, [True], [0.3], {"m/s": 0.3}])
def test_a_speed_that_is_no_number(hung, v):
    with every(0.01, lambda: hung.desired.put(command(v))):
        assert hung.stands()


def test_what_was_recorded_is_sent_again(hung):
    samples = list(hung.tape.samples)
    assert len(samples) > 10
    with keep_putting(hung, samples[-200:] * 2):
        assert hung.stands()


def test_what_a_former_life_of_the_tracker_sent(hung):
    with keep_putting(hung, hung.former * 20):
        assert hung.stands()


@pytest.mark.parametrize(
    "source", [Source.of("r2", "tracker"), Source.of("r1", "operator"), Source.of("", ""), Source.of("r1", "safety")]
)
def test_a_command_from_another_robot_or_process(hung, source):
    with keep_putting(hung, sealed(command(0.3), source)):
        assert hung.stands()


def test_a_command_of_the_trackers_with_another_payload(hung):
    (_, attachment), payload = hung.tape.samples[-1], wire.encode(command(0.3))
    with keep_putting(hung, [(payload, attachment)] * 400):
        assert hung.stands()


def test_a_session_of_another_robot_reaches_this_one_under_no_key(hung):
    stranger = Bus("r2", "tracker", hung.robot.endpoint, shared_memory=False)
    with stranger, every(0.01, lambda: stranger.publisher(topics.DESIRED).put(command(0.3))):
        assert hung.stands()


def test_a_second_tracker_beside_the_one_that_drives(crew):
    """It speaks ten times as often, and never gets a word in."""
    with crew.state_is(StateName.REPEAT_FOLLOW):
        crew.until(lambda safe: safe.v == pytest.approx(0.4), "the robot drives")
        with keep_putting(crew, sealed(command(-0.8), Source.of("r1", "tracker"))):
            crew.safe.last()
            assert all(crew.safe.wait(5.0).message.v >= 0.0 for _ in range(50))
        crew.until(lambda safe: safe.v == pytest.approx(0.4), "the robot drives as before")


def test_commands_that_waited_while_safety_hung_are_old(crew):
    """The last word of a tracker that fell silent is not followed by a safety that wakes up later."""
    with crew.state_is(StateName.REPEAT_FOLLOW):
        crew.until(lambda safe: safe.v == pytest.approx(0.4), "the robot drives")
        os.kill(crew.safety.pid, signal.SIGSTOP)
        try:
            crew.safe.last()
            time.sleep(0.6)  # how long it hangs, with commands coming in for half of it
            crew.silent = True
            time.sleep(0.6)
            woken = now_ns()
        finally:
            os.kill(crew.safety.pid, signal.SIGCONT)
        after = [crew.safe.wait(5.0).message for _ in range(30)]
        assert all(safe.v == 0.0 for safe in after if safe.stamp > woken + 30_000_000)
        crew.silent = False
        crew.until(lambda safe: safe.v == pytest.approx(0.4), "the robot drives as before")
