"""Waiting for a repeat: it ends when the navigator says that it has, well or otherwise."""

import pytest

from cli import client, waiting
from cli.errors import CommandError
from cli.robot import load
from cli.waiting import RepeatWatch
from common import topics
from common.messages import State, StateName, VelocityCommand, now_ns
from tests.processes import Robot, eventually


@pytest.fixture
def robot(tmp_path):
    with Robot(tmp_path) as robot:
        yield robot


@pytest.fixture
def navigator(robot):
    """Shows a state as the navigator does."""
    bus = robot.act_as("navigator")
    publisher = bus.publisher(topics.STATE)

    def show(name, reason="", **fields):
        stamp = now_ns()
        publisher.put(State(stamp=stamp, name=name, environment="default", since=stamp, reason=reason, **fields))

    return show


def _route_is_known(robot, bus):
    """Waits until what ``bus`` subscribed to is known everywhere: the router takes declarations in their order."""
    probe = bus.subscribe(topics.DESIRED)
    publisher = robot.bus("tracker").publisher(topics.DESIRED)

    def heard():
        publisher.put(VelocityCommand(stamp=now_ns(), v=0.0, w=0.0))
        return probe.wait(0.05)

    eventually(heard, "the watch is known to the router")


def _watched(robot, story):
    """What a watch says of the states that ``story`` shows once it listens."""
    with client.connect(load(robot.config)) as bus:
        watch = RepeatWatch(bus)
        _route_is_known(robot, bus)
        story()
        return watch.until_done()


def test_it_waits_through_plan_localize_pause_and_follow_until_the_goal(robot, navigator):
    def story():
        for name in ("REPEAT_PLAN", "REPEAT_METRIC_LOCALIZE", "REPEAT_FOLLOW", "PAUSED", "REPEAT_FOLLOW"):
            navigator(StateName[name], "on the way")
        navigator(StateName.IDLE, "reached dock")

    assert _watched(robot, story).text == "reached dock"


def test_a_repeat_that_ends_elsewhere_is_an_error_with_its_reason(robot, navigator):
    def story():
        navigator(StateName.REPEAT_METRIC_LOCALIZE)
        navigator(StateName.IDLE, "not localized within 30 s")

    with pytest.raises(CommandError, match="not localized within 30 s"):
        _watched(robot, story)


def test_an_idle_robot_that_never_begins_is_not_waited_for(robot, navigator, monkeypatch):
    monkeypatch.setattr(waiting, "_BEGIN_DEADLINE_S", -1.0)
    with pytest.raises(CommandError, match="did not begin: no map"):
        _watched(robot, lambda: navigator(StateName.IDLE, "no map"))


def test_a_navigator_that_falls_silent_is_reported(robot, navigator, monkeypatch):
    monkeypatch.setattr(waiting, "_SILENCE_S", 0.4)
    with pytest.raises(CommandError, match="silent"):
        _watched(robot, lambda: navigator(StateName.REPEAT_FOLLOW))
