"""Five robots on one router: each one's commands move it alone, and each one's emergency stop stops it alone."""

import contextlib

import pytest

from common import topics
from common.messages import StateName, VelocityCommand, now_ns
from tests.processes import Robot, every
from tests.services.safety.crew import Crew

COUNT = 5


@pytest.fixture(scope="module")
def robots(tmp_path_factory):
    with contextlib.ExitStack() as stack:
        first = stack.enter_context(Robot(tmp_path_factory.mktemp("r0"), name="r0"))
        others = [
            stack.enter_context(Robot(tmp_path_factory.mktemp(f"r{k}"), name=f"r{k}", beside=first))
            for k in range(1, COUNT)
        ]
        crews = [Crew(robot) for robot in (first, *others)]
        for k, crew in enumerate(crews):
            crew.speed, crew.turn = 0.1 * (k + 1), 0.02 * k
            crew.robot.start("safety")
            stack.enter_context(every(0.04, crew.publish))
        yield crews


def drives(crew):
    return lambda safe: safe.v == pytest.approx(crew.speed) and safe.w == pytest.approx(crew.turn)


def test_each_robot_drives_as_its_own_tracker_says(robots):
    with contextlib.ExitStack() as stack:
        for crew in robots:
            stack.enter_context(crew.state_is(StateName.REPEAT_FOLLOW))
        for crew in robots:
            crew.until(drives(crew), f"{crew.robot.name} drives at its own speed")


def test_one_robot_s_state_and_emergency_stop_are_its_own(robots):
    stopped, *others = robots
    with contextlib.ExitStack() as stack:
        for crew in robots:
            stack.enter_context(crew.state_is(StateName.REPEAT_FOLLOW))
        for crew in robots:
            crew.until(drives(crew), "it drives")
        stopped.command("stop", "one robot only")
        stopped.until(lambda safe: safe.v == 0.0, "it stands")
        for crew in others:
            crew.until_status(lambda status: status.passing and not status.latched, "the others drive on")
            crew.until(drives(crew), "at their speed")
        stopped.command("reset")


def test_a_robot_hears_nothing_that_another_publishes(robots):
    one, other = robots[:2]
    heard = one.operator.subscribe(topics.DESIRED)
    alien = other.robot.bus("tracker")
    commands = alien.publisher(topics.DESIRED)
    assert commands.key.startswith(f"vtr/{other.robot.name}/")
    commands.put(VelocityCommand(stamp=now_ns(), v=1.4, w=0.0))
    with one.state_is(StateName.REPEAT_FOLLOW):
        for _ in range(20):
            received = heard.wait(5.0)
            assert received is not None
            assert received.message.v == pytest.approx(one.speed)
