"""An operator's commands against a bus on which the test answers for the robot."""

import json

import pytest

from common import topics
from common.errors import RetraverseError
from common.ids import VertexId, new_map_id
from common.messages import Done, MapList, MapRecord, MapSummary, SafetyStatus, State, StateName, StopReason, now_ns
from common.posegraph import PoseGraph, to_topology
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
        if command.goal is not None and command.goal.to == "atlantis":
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
    assert (repeat.action, repeat.goal.to, repeat.vertex) == ("repeat", "gate", VERTEX)
    assert (repeat.goal.record, unrecorded.goal.record) == (None, False)
    assert (placed.action, placed.vertex, placed.find) == ("position", VERTEX, False)
    assert (found.vertex, found.find, found.environment) == (None, True, "park")
    assert cancel.action == "cancel"


def test_goals_wait_behind_one_another_and_the_present_one_is_swapped(robot, orders, vtr):
    vtr("repeat", "gate", "shed", "dock", "--rest-after", "5", "-c", robot.config)
    vtr("repeat", "yard", "--append", "--rest-before", "2", "-c", robot.config)
    vtr("repeat", "home", "--swap", "-c", robot.config)
    vtr("cancel", "--goal", "2", "-c", robot.config)
    vtr("pause", "--at-vertex", "-c", robot.config)
    told = [(one.action, one.goal and one.goal.to) for one in orders]
    assert told == [
        ("repeat", "gate"), ("append", "shed"), ("append", "dock"), ("append", "yard"), ("swap", "home"),
        ("drop", None), ("pause", None),
    ]  # fmt: skip
    assert {one.goal.pause_after for one in orders[:3]} == {5.0}
    assert (orders[3].goal.pause_before, orders[5].number, orders[6].at_vertex) == (2.0, 2, True)
    assert vtr("repeat", "a", "--append", "--swap").code == 1
    assert "beginning of a repeat" in vtr("repeat", "a", "--append", "--from", str(VERTEX)).sentence


def test_a_merge_names_its_candidates_by_place_or_vertex_with_their_neighbours(robot, orders, vtr):
    graph = PoseGraph("yard")
    graph.add_experience(MapRecord(id=VERTEX.map_id, environment="yard", stamp=0, robot="r1", sensor="stereo"))
    for index in range(8):
        graph.add_vertex(VertexId(VERTEX.map_id, index))
    graph.name_place("gate", VertexId(VERTEX.map_id, 6))
    robot.act_as("mapstore").serve(topics.TOPOLOGY, lambda _: to_topology(graph))
    states = robot.bus("navigator").publisher(topics.STATE)
    states.put(State(stamp=1, name=StateName.TEACH_BRANCH, environment="yard", since=1, reason="a map"))
    assert vtr("merge", "gate", f"{VERTEX.map_id}:0", "-c", robot.config).code == 0
    assert [vertex.index for vertex in orders[0].candidates] == [6, 0, 4, 5, 7, 1, 2]
    assert "neither a vertex" in vtr("merge", "nowhere", "-c", robot.config).sentence
    assert "has no vertex" in vtr("merge", f"{VERTEX.map_id}:99", "-c", robot.config).sentence
    for option, action in (("--confirm", "confirm"), ("--reject", "reject"), ("--leave", "branch")):
        vtr("merge", option, "-c", robot.config)
        assert orders[-1].action == action
    assert vtr("merge").code == 1
    assert vtr("merge", "gate", "--confirm").code == 1


def test_a_stretch_is_blocked_slowed_and_freed(robot, orders, vtr):
    record = MapRecord(id=VERTEX.map_id, environment="yard", stamp=0, robot="r1", sensor="stereo")
    summary = MapSummary(record=record, vertices=8, length=3.0, bytes=1, finished=True)
    robot.act_as("mapstore").serve(topics.MAPS, lambda _: MapList(maps=[summary]))
    vtr("maps", "block", VERTEX.map_id, "--reason", "a lorry", "-c", robot.config)
    vtr("maps", "limit", f"{VERTEX.map_id}:2-5", "0.4", "-c", robot.config)
    vtr("maps", "free", f"{VERTEX.map_id}:3", "-c", robot.config)
    told = [(one.restriction.first, one.restriction.last, one.restriction.speed) for one in orders]
    assert told == [(0, 7, 0.0), (2, 5, 0.4), (3, 3, None)]
    assert orders[0].restriction.reason == "a lorry"
    for wrong in ("5-2", "3-8", "x"):
        assert vtr("maps", "block", f"{VERTEX.map_id}:{wrong}", "-c", robot.config).code == 1


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
