"""An operator's commands against a bus on which the test answers for the robot."""

import json

import pytest

from common import topics
from common.errors import RetraverseError
from common.ids import VertexId, new_map_id
from common.messages import Done, SafetyStatus, State, StateName, StopReason, now_ns
from tests.processes import Robot

VERTEX = VertexId(new_map_id("r1", 0), 3)


@pytest.fixture
def robot(tmp_path):
    with Robot(tmp_path) as robot:
        yield robot


@pytest.fixture
def orders(robot):
    """The commands that reached the navigator; a goal that it does not know is refused."""
    received = []

    def answer(command):
        received.append(command)
        if command.goal == "atlantis":
            raise RetraverseError("there is no place 'atlantis' in environment 'default'")
        return Done(text="understood")

    robot.act_as("navigator").serve(topics.MISSION, answer)
    return received


def test_orders_arrive_as_they_were_given(robot, orders, vtr):
    assert vtr("teach", "--start-place", "dock", "-c", robot.config).out == "understood\n"
    vtr("teach", "--finish", "--end-place", "gate", "-c", robot.config)
    vtr("repeat", "gate", "--from", str(VERTEX), "-c", robot.config)
    vtr("repeat", "gate", "--no-record", "-c", robot.config)
    vtr("position", str(VERTEX), "-c", robot.config)
    found = vtr("position", "--find", "-e", "park", "--json", "-c", robot.config)
    assert json.loads(found.out) == {"action": "position", "text": "understood"}
    assert json.loads(vtr("cancel", "--json", "-c", robot.config).out) == {"action": "cancel", "text": "understood"}
    teach, finish, repeat, unrecorded, placed, found, cancel = orders
    assert (teach.action, teach.start_place) == ("teach", "dock")
    assert (finish.action, finish.end_place) == ("finish", "gate")
    assert (repeat.action, repeat.goal, repeat.vertex) == ("repeat", "gate", VERTEX)
    assert (repeat.record, unrecorded.record) == (None, False)
    assert (placed.action, placed.vertex, placed.find) == ("position", VERTEX, False)
    assert (found.vertex, found.find, found.environment) == (None, True, "park")
    assert cancel.action == "cancel"


@pytest.mark.parametrize("arguments", [(), (str(VERTEX), "--find")], ids=["nothing", "both"])
def test_a_position_is_named_or_looked_for(vtr, arguments):
    result = vtr("position", *arguments)
    assert result.code == 1
    assert "--find" in result.sentence


@pytest.mark.usefixtures("orders")
def test_an_unknown_goal_is_refused_in_the_navigators_words(robot, vtr):
    result = vtr("repeat", "atlantis", "-c", robot.config)
    assert result.code == 1
    assert result.sentence == "there is no place 'atlantis' in environment 'default'"
    assert result.out == ""


def test_the_emergency_stop_goes_to_safety_alone(robot, orders, vtr):
    received = []

    def answer(command):
        received.append(command.action)
        return Done()

    robot.act_as("safety").serve(topics.SAFETY_COMMAND, answer)
    assert vtr("estop", "-c", robot.config).code == 0
    assert vtr("estop", "--reset", "-c", robot.config).code == 0
    assert received == ["stop", "reset"]
    assert orders == []


def test_the_state_is_shown_with_every_reason_of_safety(robot, vtr):
    stamp = now_ns()
    state = State(
        stamp=stamp, name=StateName.IDLE, environment="default", since=stamp, reason="reached gate", position=VERTEX
    )
    reasons = [StopReason(rule="emergency_stop", text="The emergency stop is latched: a test")]
    status = SafetyStatus(stamp=stamp, passing=False, scale=0.0, latched=True, reasons=reasons)
    navigator = robot.act_as("navigator").publisher(topics.STATE)
    navigator.put(state)
    safety = robot.act_as("safety").publisher(topics.SAFETY_STATUS)
    safety.put(status)
    shown = json.loads(vtr("state", "--json", "-c", robot.config).out)
    assert shown["state"]["name"] == "Idle"
    assert shown["state"]["position"] == str(VERTEX)
    assert shown["safety"]["reasons"][0]["rule"] == "emergency_stop"
    text = vtr("state", "-c", robot.config).out
    assert "reached gate" in text
    assert "emergency stop latched" in text


def test_a_robot_without_navigator_has_no_state(robot, vtr, monkeypatch):
    monkeypatch.setattr("cli.views.state._DEADLINE_S", 0.2)
    result = vtr("state", "-c", robot.config)
    assert result.code == 1
    assert "navigator" in result.sentence
