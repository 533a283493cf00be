"""The pose graph in memory: transforms along paths, shortest paths, windows, and what it refuses."""

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
from common.posegraph import Edge, PoseGraph, check, from_topology, to_topology

ENVIRONMENT = "yard"


def map_id(number: int) -> str:
    return f"20261122T204500{number:06d}-r1-00000{number}"


def record(number: int, generation: int = 0, environment: str = ENVIRONMENT) -> MapRecord:
    parent = map_id(0) if generation else None
    return MapRecord(
        id=map_id(number), environment=environment, stamp=number, robot="r1", sensor="front",
        generation=generation, parent=parent,
    )  # fmt: skip


def vertex(number: int, index: int) -> VertexId:
    return VertexId(map_id(number), index)


def random_pose(rng: np.random.Generator, metres: float = 1.0) -> np.ndarray:
    return geometry.exp(np.concatenate([rng.normal(size=3) * metres, rng.normal(size=3) * 0.5]))


def random_covariance(rng: np.random.Generator) -> np.ndarray:
    root = rng.normal(size=(6, 6)) * 1e-2
    return root @ root.T


class World:
    """Random graphs whose frames are known, so that every transform has a true value."""

    def __init__(self, seed: int, maps: int = 3, vertices: int = 5, spatial: int = 4) -> None:
        rng = np.random.default_rng(seed)
        self.graph = PoseGraph(ENVIRONMENT)
        self.poses: dict[VertexId, np.ndarray] = {}
        for number in range(maps):
            self.graph.add_experience(record(number, generation=min(number, 1)))
            for index in range(vertices):
                self.graph.add_vertex(vertex(number, index))
                self.poses[vertex(number, index)] = random_pose(rng)
                if index:
                    self.join(vertex(number, index - 1), vertex(number, index), rng, spatial=False)
        everything = list(self.poses)
        for _ in range(spatial):
            a, b = (everything[k] for k in rng.choice(len(everything), 2, replace=False))
            if b not in self.graph.neighbours(a):
                self.join(a, b, rng, spatial=True)

    def join(self, a: VertexId, b: VertexId, rng: np.random.Generator, *, spatial: bool) -> None:
        self.graph.add_edge(Edge(a, b, Uncertain(self.true(a, b), random_covariance(rng)), spatial))

    def true(self, a: VertexId, b: VertexId) -> np.ndarray:
        return geometry.inverse(self.poses[a]) @ self.poses[b]

    def distances(self) -> dict[tuple[VertexId, VertexId], float]:
        """All shortest distances by Floyd and Warshall."""
        everything = list(self.poses)
        far = dict.fromkeys(itertools.product(everything, repeat=2), math.inf)
        far.update({(v, v): 0.0 for v in everything})
        for edge in self.graph.edges:
            far[edge.a, edge.b] = far[edge.b, edge.a] = edge.length
        for k, i, j in itertools.product(everything, repeat=3):
            far[i, j] = min(far[i, j], far[i, k] + far[k, j])
        return far


def chain(count: int, step: float = 1.0) -> PoseGraph:
    graph = PoseGraph(ENVIRONMENT)
    graph.add_experience(record(0))
    for index in range(count):
        graph.add_vertex(vertex(0, index))
        if index:
            T = Uncertain(geometry.from_xy_yaw(step, 0, 0), np.eye(6) * 1e-4)
            graph.add_edge(Edge(vertex(0, index - 1), vertex(0, index), T, spatial=False))
    return graph


@settings(max_examples=25)
@given(st.integers(0, 2**32))
def test_shortest_paths_are_those_of_brute_force(seed: int) -> None:
    world = World(seed)
    distances = world.distances()
    for a, b in itertools.product(world.poses, repeat=2):
        if math.isinf(distances[a, b]):
            with pytest.raises(GraphError, match="no path"):
                world.graph.shortest_path(a, b)
        else:
            path = world.graph.shortest_path(a, b)
            assert (path[0], path[-1]) == (a, b)
            assert world.graph.length_along(path) == pytest.approx(distances[a, b], abs=1e-9)


@settings(max_examples=25)
@given(st.integers(0, 2**32))
def test_transforms_along_paths_are_the_true_ones_in_both_directions(seed: int) -> None:
    world = World(seed)
    start = vertex(0, 2)
    for goal in world.graph.reachable(start):
        forth, back = world.graph.transform(start, goal), world.graph.transform(goal, start)
        assert np.allclose(forth.T, world.true(start, goal), atol=1e-9)
        assert np.allclose((forth @ back).T, np.eye(4), atol=1e-9)
        assert np.allclose(back.covariance, forth.inverse().covariance, atol=1e-12)


@settings(max_examples=25)
@given(st.integers(0, 2**32))
def test_the_covariance_of_a_path_is_that_of_its_edges_composed_one_by_one(seed: int) -> None:
    world = World(seed)
    path = world.graph.shortest_path(vertex(0, 4), vertex(0, 0))
    composed = Uncertain.identity()
    for a, b in itertools.pairwise(path):
        composed = composed @ world.graph.edge(a, b).transform(a)
    along = world.graph.transform_along(path)
    assert np.allclose(along.T, composed.T, atol=1e-12)
    assert np.allclose(along.covariance, composed.covariance, atol=1e-12)


@settings(max_examples=25)
@given(st.integers(0, 2**32), st.integers(1, 15), st.floats(0, 6))
def test_a_window_holds_the_nearest_vertices_with_their_true_poses(seed: int, count: int, metres: float) -> None:
    world = World(seed)
    distances, trunk = world.distances(), vertex(1, 2)
    window = world.graph.window(trunk, count, metres)
    expected = sorted(d for v in world.poses if (d := distances[trunk, v]) <= metres)[:count]
    assert [distances[trunk, v] for v in window] == pytest.approx(expected)
    for found, transform in window.items():
        assert np.allclose(transform.T, world.true(trunk, found), atol=1e-9)
        assert np.linalg.eigvalsh(transform.covariance)[0] > -1e-12


@settings(max_examples=25)
@given(st.integers(0, 2**32), st.floats(0, 6))
def test_what_is_within_some_metres_is_what_brute_force_says(seed: int, metres: float) -> None:
    world = World(seed)
    start = vertex(1, 2)
    expected = {v: d for (a, v), d in world.distances().items() if a == start and d <= metres}
    found = world.graph.within(start, metres)
    assert found == pytest.approx(expected)
    assert list(found.values()) == sorted(found.values())
    alone = world.graph.within(start, metres, lambda v: v.map_id == start.map_id)
    assert {v.map_id for v in alone} == {start.map_id}


def test_a_window_reaches_another_experience_through_a_spatial_edge() -> None:
    graph = chain(5)
    graph.add_experience(record(1, generation=1))
    graph.add_vertex(vertex(1, 0))
    graph.add_edge(Edge(vertex(1, 0), vertex(0, 2), Uncertain.exactly(geometry.from_xy_yaw(0.1, 0, 0)), spatial=True))
    assert list(graph.window(vertex(0, 2), 2)) == [vertex(0, 2), vertex(1, 0)]
    assert set(graph.window(vertex(0, 2), 9, metres=1.0)) == {vertex(0, 1), vertex(0, 2), vertex(0, 3), vertex(1, 0)}
    taught = graph.window(vertex(0, 2), 9, metres=1.0, allow=graph.privileged)
    assert vertex(1, 0) not in taught


def test_neighbours_by_kind_of_edge() -> None:
    graph = chain(3)
    graph.add_experience(record(1))
    graph.add_vertex(vertex(1, 0))
    graph.add_edge(Edge(vertex(1, 0), vertex(0, 1), Uncertain.identity(), spatial=True))
    assert graph.neighbours(vertex(0, 1), spatial=False) == [vertex(0, 0), vertex(0, 2)]
    assert graph.neighbours(vertex(0, 1), spatial=True) == [vertex(1, 0)]
    assert len(graph.neighbours(vertex(0, 1))) == 3


def test_poses_along_a_path_begin_with_the_identity_and_stay_rigid() -> None:
    graph = chain(2000, step=0.3)
    poses = graph.poses_along(graph.vertices(map_id(0)))
    assert np.array_equal(poses[0], np.eye(4))
    assert poses[-1, 0, 3] == pytest.approx(1999 * 0.3)
    assert geometry.is_transform(poses)
    backwards = graph.poses_along(graph.vertices(map_id(0))[::-1])
    assert backwards[-1, 0, 3] == pytest.approx(-1999 * 0.3)


def test_a_path_of_one_vertex_is_the_identity_known_exactly() -> None:
    own = chain(1).transform(vertex(0, 0), vertex(0, 0))
    assert np.array_equal(own.T, np.eye(4))
    assert not own.covariance.any()


@settings(max_examples=15)
@given(st.integers(0, 2**32))
def test_the_topology_and_back_is_the_same_graph(seed: int) -> None:
    graph = World(seed).graph
    graph.name_place("barn", vertex(0, 4))
    graph.experiences[map_id(0)].finished = True
    graph.experiences[map_id(0)].bytes = 1234
    topology = to_topology(graph)
    again = from_topology(topology)
    assert again.experiences == graph.experiences
    assert again.places == graph.places
    assert len(again) == len(graph)
    for old, new in zip(graph.edges, again.edges, strict=True):
        assert (old.a, old.b, old.spatial) == (new.a, new.b, new.spatial)
        assert np.array_equal(old.T_a_b.T, new.T_a_b.T)
        assert np.array_equal(old.T_a_b.covariance, new.T_a_b.covariance)
    lengths = [summary.length for summary in topology.maps]
    temporal = [edge for edge in graph.edges if not edge.spatial]
    assert sum(lengths) == pytest.approx(sum(edge.length for edge in temporal))


def test_an_empty_graph_has_an_empty_topology() -> None:
    assert len(from_topology(to_topology(PoseGraph(ENVIRONMENT)))) == 0


@pytest.mark.parametrize("ends", [(1, 0, 0, 0), (0, 9, 0, 0), (0, -1, 0, 0), (0, 0, -1, 0), (0, 0, 0, 3)])
def test_a_topology_whose_edge_ends_nowhere_is_refused(ends: tuple[int, ...]) -> None:
    topology = to_topology(chain(3))
    edges = topology.edges.copy()
    edges[1] = ends
    with pytest.raises(GraphError, match="edge 1 of the topology"):
        from_topology(topology.model_copy(update={"edges": edges}))


def test_a_topology_with_arrays_of_two_lengths_is_refused() -> None:
    topology = to_topology(chain(3))
    with pytest.raises(GraphError, match="differ in length"):
        from_topology(topology.model_copy(update={"spatial": topology.spatial[:1]}))


def test_what_contradicts_the_graph_is_refused_and_changes_nothing() -> None:
    graph = chain(3)
    identity = Uncertain.identity()
    with pytest.raises(GraphError, match="next vertex of its map is 3"):
        graph.add_vertex(vertex(0, 4))
    with pytest.raises(GraphError, match="no map"):
        graph.add_vertex(vertex(1, 0))
    with pytest.raises(GraphError, match="its map has 3 vertices"):
        graph.add_edge(Edge(vertex(0, 0), vertex(0, 7), identity, spatial=True))
    with pytest.raises(GraphError, match="to itself"):
        graph.add_edge(Edge(vertex(0, 0), vertex(0, 0), identity, spatial=True))
    with pytest.raises(GraphError, match="already"):
        graph.add_edge(Edge(vertex(0, 1), vertex(0, 0), identity, spatial=True))
    with pytest.raises(GraphError, match="environment"):
        graph.add_experience(record(1, environment="field"))
    with pytest.raises(GraphError, match="another record"):
        graph.add_experience(record(0).model_copy(update={"stamp": 99}))
    with pytest.raises(GraphError, match="no vertex"):
        graph.name_place("barn", vertex(0, 3))
    assert len(graph) == 3
    assert len(graph.edges) == 2
    assert check(graph) == []


def test_questions_about_what_is_not_there_have_a_sentence() -> None:
    graph = chain(3)
    for question in (
        lambda: graph.transform(vertex(0, 0), vertex(0, 9)),
        lambda: graph.neighbours(vertex(5, 0)),
        lambda: graph.edge(vertex(0, 0), vertex(0, 2)),
        lambda: graph.poses_along([]),
        lambda: graph.poses_along([vertex(0, 0), vertex(0, 2)]),
        lambda: graph.window(vertex(0, 3), 5),
        lambda: graph.within(vertex(0, 3), 5.0),
        lambda: graph.vertices("nothing"),
    ):
        with pytest.raises(GraphError):
            question()


def test_check_lists_what_a_graph_should_not_hold() -> None:
    graph = chain(2)
    graph.add_vertex(vertex(0, 2))
    bent = np.eye(4)
    bent[0, 0] = 1.1
    graph.add_edge(Edge(vertex(0, 0), vertex(0, 2), Uncertain(bent, np.eye(6)), spatial=False))
    graph.add_experience(record(1, generation=2))
    graph.add_vertex(vertex(1, 0))
    graph.add_vertex(vertex(1, 1))
    graph.add_edge(Edge(vertex(1, 0), vertex(1, 1), Uncertain(np.eye(4), -np.eye(6)), spatial=False))
    graph.add_experience(record(2))
    graph.places["barn"] = vertex(7, 0)
    found = "\n".join(check(graph))
    for sentence in (
        "is of generation 2, its parent of 0",
        f"no temporal edge joins {vertex(0, 1)} and {vertex(0, 2)}",
        "do not follow each other",
        "no rigid transform",
        "negative variance",
        "no spatial edge joins it",
        f"map {map_id(2)} has no vertices",
        "place 'barn'",
    ):
        assert sentence in found


def test_maps_recorded_in_repeats_are_sound_as_long_as_they_are_joined() -> None:
    graph = chain(4)
    for number in (1, 2, 3):
        graph.add_experience(record(number, generation=1))
        for index in range(3):
            graph.add_vertex(vertex(number, index))
            if index:
                T = Uncertain(geometry.from_xy_yaw(1, 0, 0), np.eye(6) * 1e-4)
                graph.add_edge(Edge(vertex(number, index - 1), vertex(number, index), T, spatial=False))
        if number < 3:
            joined = Uncertain(geometry.from_xy_yaw(0.1, 0, 0), np.eye(6) * 1e-4)
            graph.add_edge(Edge(vertex(0, number), vertex(number, 1), joined, spatial=True))
    assert check(graph) == [f"map {map_id(3)} was repeated, and no spatial edge joins it to another"]
    assert [e.privileged for e in graph.experiences.values()] == [True, False, False, False]


def test_ten_thousand_vertices_are_searched_end_to_end() -> None:
    graph = from_topology(to_topology(chain(10_000, step=0.2)))
    path = graph.shortest_path(vertex(0, 0), vertex(0, 9999))
    assert len(path) == 10_000
    assert graph.transform_along(path).T[0, 3] == pytest.approx(1999.8)
