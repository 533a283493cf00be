"""A network of two maps: a second one that leaves the first and is merged back to it, and repeats over both."""

import numpy as np
import pytest

from cli.soak.network import ASIDE_M, beside
from common import topics
from common.ids import VertexId
from common.messages import GraphQuery, Restriction
from common.posegraph import check, from_topology
from tests.integration.whole_robot import STILL_M_S, state_is

LENGTH_M = 16.0
LEAVES_M, JOINS_M = 3.0, 13.0


@pytest.fixture(scope="module")
def network(robot):
    """The ids of a map, and of a detour beside it that leaves it and comes back."""
    robot.calm()
    robot.forget_maps()
    robot.put_down(*robot.route[0])
    first, _ = robot.story.teach(robot.first_metres(LENGTH_M), robot.pace)
    path = robot.metres_from(LEAVES_M, JOINS_M - LEAVES_M)
    robot.put_down(*path[0])
    states = robot.states()
    count = robot.vertices()[first]
    robot.command("teach", vertex=VertexId(first, round(count * LEAVES_M / LENGTH_M)))
    robot.soon(lambda: state_is(states, "Teach.Branch"), "the robot branches off", 20.0)
    detour = beside(path)
    human = robot.drive_by_hand(detour)
    assert human.arrived.wait(60)
    robot.soon(lambda: robot.speed() < STILL_M_S, "the robot stands")
    middle = round(count * JOINS_M / LENGTH_M)
    candidates = [VertexId(first, index) for index in range(middle - 3, middle + 4)]
    robot.command("merge", candidates=candidates)
    robot.soon(lambda: states.last().message.closure is not None, "a loop closure is offered", 20.0)
    robot.command("confirm", timeout=30.0)
    human.stop()
    second = robot.taught()[-1]
    return first, second


def graph_of(robot):
    return from_topology(robot.bus.ask(topics.TOPOLOGY, GraphQuery(environment="garden"), timeout=5.0))


def farthest_aside(robot, goal):
    """Drives to a goal; how far from the first map's middle the robot came by."""
    states = robot.states()
    middle = robot.first_metres((LEAVES_M + JOINS_M) / 2)[-1, :2]
    nearest = [np.inf]

    def there():
        nearest[0] = min(nearest[0], float(np.linalg.norm(robot.standing()[:2] - middle)))
        return state_is(states, "Idle")

    robot.command("repeat", goal=goal, record=False)
    robot.soon(lambda: not state_is(states, "Idle"), "the repeat begins", 20.0)
    robot.soon(there, f"the repeat to {goal} ends", 90.0)
    assert states.last().message.reason == f"reached {goal}"
    return nearest[0]


def test_the_loop_closure_is_an_edge_and_the_graph_whole(robot, network):
    first, second = network
    graph = graph_of(robot)
    assert check(graph) == []
    ends = [{edge.a.map_id, edge.b.map_id} for edge in graph.edges if edge.spatial]
    assert ends.count({first, second}) == 2, "where it leaves, and where it comes back"


def test_repeats_go_the_short_way_or_past_what_is_blocked_forwards_and_backwards(robot, network):
    first, _ = network
    robot.put_down(*robot.route[0])
    robot.command("position", vertex=VertexId(first, 0))
    count = robot.vertices()[first]
    blocked = Restriction(map=first, first=round(count * 0.4), last=round(count * 0.6), reason="a lorry")
    assert "is blocked" in robot.command("restrict", restriction=blocked).text
    try:
        assert farthest_aside(robot, "end") > ASIDE_M - 0.2
        assert farthest_aside(robot, "start") > ASIDE_M - 0.2
    finally:
        robot.command("restrict", restriction=blocked.model_copy(update={"speed": None}))
    assert farthest_aside(robot, "end") < 0.15


def test_goals_one_after_another_with_a_pause_at_a_vertex(robot, network):
    first, _ = network
    states = robot.states()
    robot.put_down(*robot.route[0])
    robot.command("position", vertex=VertexId(first, 0))
    robot.command("repeat", goal=f"{first}:12", record=False, pause_after=0.5)
    robot.command("append", goal="start", record=False)
    robot.soon(lambda: robot.speed() > 0.6, "it drives", 30.0)
    robot.command("pause", at_vertex=True)
    vertex = robot.soon(lambda: states.last().message.pauses_at, "it tells where it will pause")
    robot.soon(lambda: state_is(states, "Paused"), "it pauses", 20.0)
    assert states.last().message.reason == f"paused by the operator at {vertex}"
    metres = np.linalg.norm(graph_of(robot).transform(VertexId(first, 0), vertex).T[:3, 3])
    assert np.linalg.norm(robot.standing()[:2] - robot.route[0, :2]) == pytest.approx(metres, abs=0.3), vertex
    robot.command("resume")
    robot.soon(lambda: "reached" in states.last().message.reason, "the first goal is reached", 60.0)
    robot.soon(lambda: state_is(states, "Idle"), "the second goal is reached", 90.0)
    assert states.last().message.reason == "reached start"
    assert np.linalg.norm(robot.standing()[:2] - robot.route[0, :2]) < 0.2
