"""Repeats leave experiences behind; by them, and by what places look like, a robot knows its place in other light."""

import re

import numpy as np
import pytest

from common import topics
from common.errors import BusError
from common.ids import VertexId
from common.messages import Command, GraphQuery, WorldTime, now_ns
from common.posegraph import check, from_topology
from services.sensors.world import WorldSettings
from tests.integration.whole_robot import state_is

pytestmark = pytest.mark.long

SHORT_M = 12.0
HOUR_NS = 3_600_000_000_000
NOON_NS = round(WorldSettings().time.timestamp() * 1e9)


@pytest.fixture
def sun(robot):
    """Sets the time of day, hours from the world's own; at the end it is as it was."""

    def move(hours):
        robot.bus.ask(topics.TRUTH_TIME, WorldTime(stamp=NOON_NS + round(hours * HOUR_NS)), timeout=30.0)

    yield move
    move(0.0)


def put_down_and_seen(robot, *pose):
    """Carries the robot somewhere, and waits until its camera has seen that it is there."""
    odometry = robot.bus.subscribe(topics.ODOMETRY)
    robot.put_down(*pose)
    there = now_ns()
    robot.soon(lambda: odometry.last() is not None and odometry.last().message.stamp > there, "a frame from there")


def graph_of(robot):
    return from_topology(robot.bus.ask(topics.TOPOLOGY, GraphQuery(environment="garden"), timeout=5.0))


def repeat_to_the_end(robot, goal, **fields):
    states = robot.states()
    robot.command("repeat", goal=goal, **fields)
    robot.soon(lambda: state_is(states, "Repeat.Follow"), "the robot follows", 20.0)
    robot.soon(lambda: state_is(states, "Idle"), "the repeat ends", 90.0)
    assert states.last().message.reason.startswith("reached")


def test_a_repeat_records_an_experience_joined_to_the_taught_route(robot):
    robot.calm()
    robot.forget_maps()
    robot.put_down(*robot.route[0])
    taught, _ = robot.story.teach(robot.first_metres(SHORT_M), robot.pace)
    robot.put_down(*robot.route[0])
    repeat_to_the_end(robot, taught, vertex=(taught, 0))
    robot.soon(lambda: len(robot.maps()) == 2 and robot.maps()[1].finished, "the experience is stored", 10.0)
    recorded = robot.maps()[1]
    assert (recorded.record.generation, recorded.record.parent) == (1, taught)
    assert recorded.length == pytest.approx(SHORT_M, abs=1.5)
    graph = graph_of(robot)
    assert check(graph) == []
    spatial = [edge for edge in graph.edges if edge.spatial]
    assert len(spatial) >= 0.9 * recorded.vertices
    assert {edge.a.map_id for edge in spatial} == {taught}


def test_a_repeat_may_leave_nothing_behind(robot):
    robot.calm()
    taught, before = robot.taught()[0], len(robot.maps())
    robot.put_down(*robot.route[0])
    repeat_to_the_end(robot, taught, vertex=(taught, 0), record=False)
    assert len(robot.maps()) == before


def test_in_other_light_a_robot_that_was_carried_finds_itself_and_drives_on(robot, sun):
    robot.calm()
    taught = robot.taught()[0]
    sun(5.0)
    half_way = robot.first_metres(SHORT_M / 2.0)[-1]
    x, y, yaw = half_way
    put_down_and_seen(robot, x + 0.2, y + 0.1, yaw + 0.05)
    robot.soon(lambda: robot.attempt("position", find=True), "the robot finds itself", 30.0)
    answer = robot.command("position", find=True).text
    found = VertexId(taught, int(re.search(rf"{taught}:(\d+)", answer)[1]))
    graph = graph_of(robot)
    metres = np.linalg.norm(graph.transform((taught, 0), found).T[:3, 3])
    there = np.linalg.norm(half_way[:2] - robot.route[0][:2])
    assert metres == pytest.approx(there, abs=0.8)
    repeat_to_the_end(robot, taught)
    end = robot.first_metres(SHORT_M)[-1]
    assert np.linalg.norm(robot.standing()[:2] - end[:2]) < 0.3


def test_a_robot_that_stands_nowhere_it_knows_is_told_so(robot):
    robot.calm()
    states = robot.states()
    robot.soon(lambda: states.last() is not None, "a state")
    known = states.last().message.position
    put_down_and_seen(robot, *robot.route[len(robot.route) // 2])
    with pytest.raises(BusError) as refusal:
        robot.bus.ask(topics.MISSION, Command(action="position", find=True), timeout=15.0)
    assert str(refusal.value)
    assert states.last().message.position == known
