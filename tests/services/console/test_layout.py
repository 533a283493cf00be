"""Where vertices are drawn."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.posegraph.topology import to_topology
from services.console.channel import Channel
from services.console.robot.models.graph import Drawn, GraphModel
from services.console.robot.models.layout import compose, invert, lay_out
from tests.services.console.acting import PoseGraph, add_map, loop, network, record

POSE = st.tuples(st.floats(-50, 50), st.floats(-50, 50), st.floats(-3.1, 3.1)).map(np.array)


@given(POSE, POSE)
def test_poses_compose_as_transforms_do(a, b):
    assert compose(a, invert(a)) == pytest.approx(np.zeros(3), abs=1e-9)
    assert compose(invert(a), compose(a, b))[:2] == pytest.approx(b[:2], abs=1e-9)


def test_maps_lie_where_their_edges_say():
    graph, _, poses = network(60, 2)
    drawn = lay_out(to_topology(graph))
    shown = np.concatenate([compose(poses[0], one) for one in drawn])
    truth = np.concatenate([poses + np.array([0.0, beside, 0.0]) for beside in (0.0, 0.2, 0.4)])
    assert shown[:, :2] == pytest.approx(truth[:, :2], abs=1e-6)


def test_a_drifting_repeat_is_stretched_between_its_edges():
    poses = loop(60)
    graph, taught = PoseGraph("default"), record(5)
    add_map(graph, taught, poses)
    bent = poses.copy()
    bent[:, 1] += np.linspace(0.0, 3.0, 60)
    add_map(graph, record(1, 1, taught.id), bent, (taught.id, poses), every=59)
    shown = compose(poses[0], lay_out(to_topology(graph))[1])
    assert shown[[0, 59], :2] == pytest.approx(bent[[0, 59], :2], abs=1e-6)
    assert np.linalg.norm(np.diff(shown[:, :2], axis=0), axis=1).max() < 1.0


def test_what_no_edge_joins_stands_beside():
    graph = PoseGraph("default")
    add_map(graph, record(2), loop(30))
    add_map(graph, record(1), loop(30))
    first, second = lay_out(to_topology(graph))
    assert second[:, 0].min() > first[:, 0].max()


def test_an_empty_store_and_a_map_without_vertices_are_drawn_as_nothing():
    assert lay_out(to_topology(PoseGraph("default"))) == []
    graph = PoseGraph("default")
    graph.add_experience(record())
    assert [len(one) for one in lay_out(to_topology(graph))] == [0]


def test_of_a_large_graph_that_grows_only_the_end_is_sent_again():
    graph, taught, poses = network(1500, 1)
    channel = Channel()
    model = GraphModel(channel)
    model.take(Drawn.of(to_topology(graph), 0.0))
    revision, whole = channel.since(0)
    assert len(whole) < 30 * 3000
    growing = record()
    pose = model.pose(model.around(next(iter(model.places.values())), 0)[0])
    for index in range(3):
        model.grow(growing, model.places["home"]._replace(map_id=growing.id, index=index), pose)
    revision, change = channel.since(revision)
    assert len(change) < 500
    model.take(Drawn.of(to_topology(graph), 0.0))
    assert growing.id in channel.since(revision)[1]
    assert not channel.keys(f"map/{growing.id}")
    assert len(poses) == 1500
    assert taught.id in model.taught
