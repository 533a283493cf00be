"""The planner's graphs: the store's newest, or its last while it is away."""

from __future__ import annotations

import pytest

from common import topics
from common.errors import NoAnswer
from common.ids import VertexId
from common.messages import GraphQuery, MapRecord, Topology
from common.posegraph import PoseGraph, to_topology
from services.planner.service import Graphs


class Store:
    """A map store that may be away."""

    def __init__(self) -> None:
        self.away = False
        self.vertices = 1

    def ask(self, topic: topics.Topic, question: GraphQuery, _timeout: float) -> Topology:
        assert topic is topics.TOPOLOGY
        if self.away:
            raise NoAnswer("nobody answers")
        graph = PoseGraph(str(question.environment))
        map_id = "20261122T204500000000-r1-000000"
        graph.add_experience(MapRecord(id=map_id, environment=graph.environment, stamp=0, robot="r1", sensor="stereo"))
        for index in range(self.vertices):
            graph.add_vertex(VertexId(map_id, index))
        return to_topology(graph)


def test_the_newest_graph_is_taken_and_the_last_one_while_the_store_is_away() -> None:
    store = Store()
    graphs = Graphs(store, 1.0)  # type: ignore[arg-type]
    assert len(graphs.get("yard")[0]) == 1
    store.vertices = 2
    graph, remark = graphs.get("yard")
    assert (len(graph), remark) == (2, "")
    store.away = True
    graph, remark = graphs.get("yard")
    assert len(graph) == 2
    assert "the map store gives none now" in remark
    store.away, store.vertices = False, 3
    assert (len(graphs.get("yard")[0]), graphs.get("yard")[1]) == (3, "")


def test_an_environment_that_was_never_seen_cannot_be_planned_without_the_store() -> None:
    store = Store()
    graphs = Graphs(store, 1.0)  # type: ignore[arg-type]
    graphs.get("yard")
    store.away = True
    with pytest.raises(NoAnswer):
        graphs.get("field")
