"""Routes over what was taught."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from common import geometry
from common.errors import GraphError
from common.geometry import Uncertain
from common.ids import VertexId
from common.messages import MapRecord
from common.posegraph import Edge, PoseGraph
from services.planner.route import plan, resolve


def map_id(number: int) -> str:
    return f"20261122T204500{number:06d}-r1-00000{number}"


def vertex(number: int, index: int) -> VertexId:
    return VertexId(map_id(number), index)


def add_map(graph: PoseGraph, number: int, steps: list[float], generation: int = 0, sensor: str = "stereo") -> None:
    record = MapRecord(
        id=map_id(number), environment="yard", stamp=number, robot="r1", sensor=sensor, generation=generation,
        parent=map_id(0) if generation else None,
    )  # fmt: skip
    graph.add_experience(record)
    graph.add_vertex(vertex(number, 0))
    for index, step in enumerate(steps):
        graph.add_vertex(vertex(number, index + 1))
        T = Uncertain.exactly(geometry.from_xy_yaw(step, 0, 0.1))
        graph.add_edge(Edge(vertex(number, index), vertex(number, index + 1), T, spatial=False))


def join(graph: PoseGraph, a: VertexId, b: VertexId, metres: float = 0.0) -> None:
    graph.add_edge(Edge(a, b, Uncertain.exactly(geometry.from_xy_yaw(metres, 0, 0)), spatial=True))


@pytest.fixture
def network() -> PoseGraph:
    """A trunk of five vertices, a branch from its second, and a map that nothing joins."""
    graph = PoseGraph("yard")
    add_map(graph, 0, [1.0] * 4)
    add_map(graph, 1, [1.0] * 3)
    add_map(graph, 2, [1.0] * 3)
    join(graph, vertex(1, 0), vertex(0, 1), -0.2)
    graph.name_place("dock", vertex(0, 0))
    graph.name_place("barn", vertex(1, 3))
    graph.name_place("field", vertex(2, 3))
    return graph


def test_a_route_branches_where_the_maps_are_joined(network: PoseGraph) -> None:
    found = plan(network, vertex(0, 0), "barn", "stereo")
    assert found.vertices == [vertex(0, 0), vertex(0, 1), *(vertex(1, index) for index in range(4))]
    assert found.maps == [map_id(0), map_id(1)]
    assert found.length == pytest.approx(4.2)
    assert found.path.shape == (6, 4, 4)
    assert np.array_equal(found.path[0], np.eye(4))
    assert np.allclose(found.path[2], geometry.from_xy_yaw(1, 0, 0.1) @ geometry.from_xy_yaw(0.2, 0, 0))
    assert "4.2 m" in found.reason
    assert map_id(1) in found.reason


def test_a_route_against_the_taught_direction_keeps_the_taught_headings(network: PoseGraph) -> None:
    found = plan(network, vertex(0, 4), "dock", "stereo")
    assert found.vertices == network.vertices(map_id(0))[::-1]
    forth = network.poses_along(network.vertices(map_id(0)))
    assert np.allclose(found.path, geometry.inverse(forth[-1]) @ forth[::-1])


@pytest.mark.parametrize("goal", [map_id(1), f"{map_id(1)}:3", "barn"])
def test_a_goal_is_a_map_s_end_a_vertex_or_a_place(network: PoseGraph, goal: str) -> None:
    assert resolve(network, goal) == vertex(1, 3)


@pytest.mark.parametrize(
    ("start", "goal", "sentence"),
    [
        (vertex(0, 0), "bran", "did you mean barn?"),
        (vertex(0, 0), "xyz", "the places are barn, dock, field"),
        (vertex(0, 0), map_id(0)[:-1] + "7", f"did you mean {map_id(0)}"),
        (vertex(0, 0), f"{map_id(0)}:5", "the map has vertices 0 to 4"),
        (vertex(0, 0), "20261122T204500000009-r1-000009:5", "there is no map"),
        (vertex(0, 0), "field", "no taught route leads from .* can reach barn"),
        (vertex(0, 0), "dock", "at 'dock' already"),
        (vertex(0, 0), "", "there is no place or map ''"),
        (vertex(0, 9), "barn", "the start .* is unknown: the map has vertices 0 to 4"),
        (vertex(9, 0), "barn", "the start .* is unknown: environment 'yard' has no such map"),
        (VertexId(map_id(0), -1), "barn", "the start .* is unknown"),
    ],
)
def test_each_impossible_wish_has_its_sentence(network: PoseGraph, start: VertexId, goal: str, sentence: str) -> None:
    with pytest.raises(GraphError, match=sentence) as caught:
        plan(network, start, goal, "stereo")
    assert "\n" not in str(caught.value)


def test_maps_of_another_sensor_are_of_no_use(network: PoseGraph) -> None:
    with pytest.raises(GraphError, match=r"the start .* was taught by stereo, and this robot localizes by lidar"):
        plan(network, vertex(0, 0), "barn", "lidar")


def test_without_maps_there_is_nothing_to_repeat() -> None:
    with pytest.raises(GraphError, match="teach a route first"):
        plan(PoseGraph("yard"), vertex(0, 0), "barn", "stereo")


def test_a_map_without_vertices_has_no_end(network: PoseGraph) -> None:
    record = network.experience(map_id(0)).record.model_copy(update={"id": map_id(5)})
    network.add_experience(record)
    with pytest.raises(GraphError, match="no vertices yet"):
        plan(network, vertex(0, 0), map_id(5), "stereo")


def test_without_names_a_goal_is_told_to_be_a_vertex_or_map() -> None:
    graph = PoseGraph("yard")
    add_map(graph, 0, [1.0])
    with pytest.raises(GraphError, match="name a vertex as map:index"):
        plan(graph, vertex(0, 0), "barn", "stereo")


def test_a_repeat_s_map_is_no_route_even_where_it_is_shorter(network: PoseGraph) -> None:
    add_map(network, 3, [0.1], generation=1)
    join(network, vertex(3, 0), vertex(0, 0))
    join(network, vertex(3, 1), vertex(0, 4))
    assert plan(network, vertex(0, 0), map_id(0), "stereo").length == pytest.approx(4.0)
    with pytest.raises(GraphError, match="recorded in a repeat"):
        plan(network, vertex(0, 0), map_id(3), "stereo")
    with pytest.raises(GraphError, match=r"the start .* recorded in a repeat"):
        plan(network, vertex(3, 0), "barn", "stereo")


def test_however_many_repeats_were_recorded_the_routes_stay_as_they_were(network: PoseGraph) -> None:
    wishes = [(vertex(0, 0), "barn"), (vertex(0, 4), "dock"), (vertex(1, 3), map_id(0)), (vertex(0, 2), "dock")]
    before = [plan(network, start, goal, "stereo") for start, goal in wishes]
    for number in range(10, 60):
        record = network.experience(map_id(0)).record
        recorded = record.model_copy(
            update={"id": f"20261123T204500{number:06d}-r1-0000{number}", "generation": 1, "parent": record.id}
        )
        network.add_experience(recorded)
        for index in range(5):
            here = VertexId(recorded.id, index)
            network.add_vertex(here)
            join(network, here, vertex(0, index), 0.01)
            if index:
                T = Uncertain.exactly(geometry.from_xy_yaw(0.5, 0, 0))
                network.add_edge(Edge(VertexId(recorded.id, index - 1), here, T, spatial=False))
    for (start, goal), old in zip(wishes, before, strict=True):
        new = plan(network, start, goal, "stereo")
        assert (new.vertices, new.maps, new.reason) == (old.vertices, old.maps, old.reason)
        assert np.array_equal(new.path, old.path)


def test_two_maps_joined_by_a_repeat_alone_are_not_connected(network: PoseGraph) -> None:
    add_map(network, 3, [0.1], generation=1)
    join(network, vertex(3, 0), vertex(0, 0))
    join(network, vertex(3, 1), vertex(2, 0))
    with pytest.raises(GraphError, match="no taught route"):
        plan(network, vertex(0, 0), "field", "stereo")


@settings(max_examples=40)
@given(st.data())
def test_a_route_is_the_shortest_of_all_simple_paths(data: st.DataObject) -> None:
    graph = PoseGraph("yard")
    steps = st.lists(st.floats(0.1, 5), min_size=1, max_size=3)
    for number in range(3):
        add_map(graph, number, data.draw(steps))
    everything = [v for number in range(3) for v in graph.vertices(map_id(number))]
    pairs = [pair for pair in itertools.combinations(everything, 2) if pair[1] not in graph.neighbours(pair[0])]
    for a, b in data.draw(st.lists(st.sampled_from(pairs), unique=True, max_size=4)):
        join(graph, a, b, data.draw(st.floats(0, 3)))
    start, goal = data.draw(st.permutations(everything))[:2]
    best = _brute_force(graph, start, goal, frozenset())
    if math.isinf(best):
        with pytest.raises(GraphError, match="no taught route"):
            plan(graph, start, str(goal), "stereo")
    else:
        assert plan(graph, start, str(goal), "stereo").length == pytest.approx(best)


def _brute_force(graph: PoseGraph, vertex: VertexId, goal: VertexId, seen: frozenset[VertexId]) -> float:
    """The shortest of all paths without a repeated vertex."""
    if vertex == goal:
        return 0.0
    further = [n for n in graph.neighbours(vertex) if n not in seen]
    lengths = [graph.edge(vertex, n).length + _brute_force(graph, n, goal, seen | {vertex}) for n in further]
    return min(lengths, default=math.inf)


def test_a_map_by_bearing_is_only_driven_as_it_was_taught() -> None:
    graph = PoseGraph("yard")
    add_map(graph, 0, [1.0] * 4, sensor="bearing")
    graph.name_place("dock", vertex(0, 0))
    graph.name_place("barn", vertex(0, 4))
    assert plan(graph, vertex(0, 1), "barn", "bearing").vertices == [vertex(0, index) for index in range(1, 5)]
    with pytest.raises(GraphError, match="can only be repeated as it was taught"):
        plan(graph, vertex(0, 4), "dock", "bearing")
