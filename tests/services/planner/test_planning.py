"""Routes over maps that were chosen for now: what is asked of whom, what is fetched, and how maps are joined."""

from __future__ import annotations

import numpy as np
import pytest

from common import geometry, topics
from common.environment import Theta
from common.errors import GraphError, NoAnswer, Refused, Unavailable
from common.geometry import Uncertain
from common.messages import (
    CatalogEntry,
    Done,
    EnvironmentModel,
    FleetPlan,
    PlanRequest,
    Restriction,
    SyncState,
    SyncStatus,
    Transfer,
    now_ns,
)
from common.posegraph import Edge, PoseGraph
from services.planner.fleet import Fleet
from services.planner.joints import chain
from services.planner.memory import Memory
from services.planner.planning import Planner
from services.planner.settings import Settings
from tests.services.planner.test_route import add_map, map_id, vertex

HOUR = 3_600_000_000_000


class Silent:
    """A subscription on which nothing new comes."""

    def __init__(self, message=None):
        self.message = message

    def poll(self):
        return None

    def last(self):
        return None if self.message is None else self


class Bus:
    """The fleet's server and the map store, as a planner asks them."""

    def __init__(self):
        self.status = Silent()
        self.fleet_plan = NoAnswer("the server is away")
        self.asked = []

    def subscribe(self, topic, _name="*"):
        return self.status if topic is topics.SYNC_STATUS else Silent()

    def ask(self, topic, question, _timeout, _name=""):
        self.asked.append((topic, question))
        if topic is topics.FETCH:
            return Done()
        if isinstance(self.fleet_plan, Exception):
            raise self.fleet_plan
        return self.fleet_plan


@pytest.fixture
def bus():
    return Bus()


@pytest.fixture
def memory(tmp_path):
    return Memory(tmp_path / "fleet")


@pytest.fixture
def planner(bus, memory):
    settings = Settings()
    return Planner(settings, "stereo", memory, Fleet(bus, memory, settings, "stereo", linked=True))


@pytest.fixture
def yard():
    """Two maps from gate to yard, one from yard to shed that begins where they end."""
    graph = PoseGraph("yard")
    for number, (start, end) in enumerate([("gate", "yard"), ("gate", "yard"), ("yard", "shed")]):
        add_map(graph, number, [1.0] * 5)
        experience = graph.experiences[map_id(number)]
        experience.start_place, experience.end_place, experience.finished, experience.length = start, end, True, 5.0
    return graph


def request(**fields):
    return PlanRequest(environment="yard", **({"goal": "shed", "start_place": "gate"} | fields))


def joined(graph, a, b, x, y=0.0, yaw=0.0):
    graph.add_edge(Edge(a, b, Uncertain.exactly(geometry.from_xy_yaw(x, y, yaw)), spatial=True))


def entry(number, start="gate", end="yard", **fields):
    return CatalogEntry(
        map=map_id(number), start=start, end=end, stamp=number, length=5.0, generation=0, sensor="stereo", **fields
    )


def test_without_a_server_the_robots_own_maps_are_planned_over(planner, yard):
    route = planner.route(request(), yard)
    assert route.plan == [map_id(0), map_id(2)]
    assert (route.maps, route.next_map) == ([map_id(0)], map_id(2))
    assert route.vertices == yard.vertices(map_id(0))
    assert "it is also the shortest" in route.reason


def test_the_servers_plan_is_followed_and_remembered(planner, bus, memory, yard):
    model = EnvironmentModel(environment="yard", stamp=9, revision=3, maps=3, periods_hours=[24.0], weights=[1.0],
                             phases=[0.0], significance=[0.001])  # fmt: skip
    bus.fleet_plan = FleetPlan(
        entries=[entry(1), entry(2, "yard", "shed")], cost=1.0, why=["a", "b", "both"], model=model,
        alternatives=[entry(0)],
    )  # fmt: skip
    route = planner.route(request(), yard)
    assert route.plan == [map_id(1), map_id(2)]
    assert route.why == ["a", "b", "both"]
    asked = bus.asked[0][1]
    assert (asked.start, asked.goal, asked.sensor, asked.theta) == ("gate", "shed", "stereo", (1.0, 0.0, 0.0))
    again = Memory(memory._folder).recall("yard")
    assert again.model == model
    assert {one.map for one in again.entries} == {map_id(0), map_id(1), map_id(2)}


def test_without_network_the_remembered_model_chooses(planner, memory, yard):
    now = now_ns()
    for number, hours in ((0, 12), (1, 24)):
        experience = yard.experiences[map_id(number)]
        experience.record = experience.record.model_copy(update={"stamp": now - hours * HOUR})
    memory.learn("yard", EnvironmentModel(
        environment="yard", stamp=1, revision=1, maps=9, periods_hours=[24.0], weights=[1.0], phases=[0.0],
        significance=[0.001],
    ))  # fmt: skip
    assert planner.route(request(), yard).plan[0] == map_id(1)
    assert planner.route(request(mode="explore"), yard).plan[0] == map_id(0)


def test_maps_that_are_elsewhere_are_fetched(planner, bus, memory):
    memory.learn("yard", None, [entry(0)])
    with pytest.raises(Unavailable, match="fetching 1 of the plan's 1 maps"):
        planner.route(request(goal="yard"), PoseGraph("yard"))
    assert bus.asked[-1][1].maps == [map_id(0)]
    moving = Transfer(
        map=map_id(0), environment="yard", state=SyncState.UPLOADING, upload=False, done=10**6, total=4 * 10**6
    )
    bus.status.message = SyncStatus(stamp=1, online=True, transfers=[moving])
    with pytest.raises(Unavailable, match=r"25% of 4\.0 MB"):
        planner.route(request(goal="yard"), PoseGraph("yard"))
    failed = moving.model_copy(update={"state": SyncState.QUARANTINED, "reason": "it is spoilt"})
    bus.status.message = SyncStatus(stamp=1, online=True, transfers=[failed])
    with pytest.raises(Refused, match="it is spoilt"):
        planner.route(request(goal="yard"), PoseGraph("yard"))


def test_maps_of_another_sensor_are_no_way(planner, yard):
    for experience in yard.experiences.values():
        experience.record = experience.record.model_copy(update={"sensor": "lidar"})
    with pytest.raises(GraphError, match="no map leads"):
        planner.route(request(), yard)


def test_from_the_middle_of_a_map_its_rest_comes_first(planner, yard):
    route = planner.route(request(start=vertex(0, 2), start_place=None), yard)
    assert route.plan == [map_id(0), map_id(2)]
    assert route.vertices[0] == vertex(0, 2)


def test_at_the_end_of_a_map_the_next_one_begins(planner, yard):
    joined(yard, vertex(0, 5), vertex(2, 0), 0.5)
    route = planner.route(request(start=vertex(0, 5), start_place=None), yard)
    assert route.plan == [map_id(2)]
    assert route.vertices == [vertex(0, 5), *yard.vertices(map_id(2))]


def test_a_goal_that_is_no_end_is_reached_by_the_shortest_way(planner, yard):
    yard.name_place("gate", vertex(0, 0))
    back = planner.route(request(start=vertex(0, 4), start_place=None, goal="gate"), yard)
    assert [v.index for v in back.vertices] == [4, 3, 2, 1, 0]
    assert "no plan over whole maps" in back.reason


def test_a_longer_route_begins_as_the_shorter_one(planner, yard):
    route = planner.route(request(), yard)
    joined(yard, vertex(0, 5), vertex(2, 1), 1.2, 0.1)
    longer = planner.route(request(start=route.vertices[0], start_place=None, plan=route.plan), yard)
    known = len(route.vertices)
    assert longer.vertices[:known] == route.vertices
    assert np.array_equal(longer.path[:known], route.path)
    assert longer.vertices[known:] == yard.vertices(map_id(2))
    assert longer.next_map is None
    step = geometry.inverse(longer.path[known - 1]) @ longer.path[known]
    assert step[0, 3] > 0.0


@pytest.mark.parametrize(
    ("x", "y", "yaw", "first"),
    [(0.5, 0.0, 0.0, 0), (-1.2, 0.0, 0.0, 2), (6.0, 0.0, 0.0, None), (0.5, 0.0, 1.5, None), (-20.0, 0.0, 0.0, None)],
)
def test_vertices_that_do_not_lie_ahead_are_left_out(x, y, yaw, first):
    graph = PoseGraph("yard")
    for number in (0, 1):
        graph.add_experience(_record(number))
        for index in range(6):
            graph.add_vertex(vertex(number, index))
            if index:
                T = Uncertain.exactly(geometry.from_xy_yaw(1.0, 0.0, 0.0))
                graph.add_edge(Edge(vertex(number, index - 1), vertex(number, index), T, spatial=False))
    joined(graph, vertex(0, 5), vertex(1, 0), x, y, yaw)
    found = chain(graph, vertex(0, 0), [map_id(0), map_id(1)])
    if first is None:
        assert found.next_map == map_id(1)
    else:
        assert found.vertices[6] == vertex(1, first)
        assert found.length == pytest.approx(5.0 + x + first + 5 - first)


def _record(number):
    graph = PoseGraph("yard")
    add_map(graph, number, [])
    return graph.experiences[map_id(number)].record


def test_a_spoilt_memory_is_as_none(tmp_path):
    (tmp_path / "yard.json").write_bytes(b"\x80pickle")
    memory = Memory(tmp_path)
    assert memory.recall("yard").entries == []
    memory.learn("yard", None, [entry(0)])
    assert Memory(tmp_path).recall("yard").entries == [entry(0)]


def test_trouble_that_is_known_raises_a_cost(planner, memory, yard):
    memory.learn("yard", None, [entry(0, trouble=[0.9] * 24)])
    assert planner.route(request(), yard).plan[0] == map_id(1)
    assert Theta().trouble == 1.0


def test_a_blocked_stretch_is_avoided_and_a_slow_one_is_told(planner, bus):
    graph = PoseGraph("yard")
    bus.fleet_plan = Refused("no such place")
    for k in (0, 1):
        add_map(graph, k, [1.0 + 0.1 * k] * 5)
    for ends in ((0, 0), (5, 5)):
        joined = Edge(vertex(0, ends[0]), vertex(1, ends[1]), Uncertain.identity(), spatial=True)
        graph.add_edge(joined)
    ask = PlanRequest(environment="yard", start=vertex(0, 0), goal=str(vertex(0, 5)))
    assert planner.route(ask, graph).maps == [map_id(0)]
    graph.restrictions.append(Restriction(map=map_id(0), first=2, last=3, reason="a lorry"))
    assert planner.route(ask, graph).vertices == [vertex(0, 0), *(vertex(1, k) for k in range(6)), vertex(0, 5)]
    graph.restrictions.append(Restriction(map=map_id(1), first=2, last=3, speed=0.4))
    limits = planner.route(ask, graph).speed_limits
    assert [limit for limit in limits if limit < 1.0] == [0.4] * 3
    assert limits[2:5] == [0.4] * 3, "from the vertex before the stretch to the one after it"
    graph.restrictions.append(Restriction(map=map_id(1), first=4, last=4))
    with pytest.raises(GraphError, match="past what is blocked"):
        planner.route(ask, graph)
    with pytest.raises(GraphError, match="on a stretch that is blocked"):
        planner.route(ask.model_copy(update={"goal": str(vertex(0, 3))}), graph)


def test_a_map_with_a_blocked_stretch_is_chosen_for_no_plan(planner, bus):
    graph = PoseGraph("yard")
    for k in (0, 1):
        add_map(graph, k, [1.0] * 5)
        experience = graph.experience(map_id(k))
        experience.finished, experience.start_place, experience.end_place = True, "gate", "yard"
    ask = PlanRequest(environment="yard", start_place="gate", goal="yard")
    first = planner.route(ask, graph).plan
    graph.restrictions.append(Restriction(map=first[0], first=1, last=1))
    second = planner.route(ask, graph).plan
    assert first != second
    assert bus.asked[-1][1].without == first
    graph.restrictions.append(Restriction(map=second[0], first=1, last=1))
    with pytest.raises(GraphError):
        planner.route(ask, graph)
