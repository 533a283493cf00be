"""Commits, questions and removals."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from common import geometry
from common.errors import GraphError
from common.ids import VertexId
from common.messages import Commit, GraphQuery, NamePlace, Topology
from common.posegraph import check, from_topology
from services.mapstore.store import Store
from tests.services.mapstore.graphs import (
    drive,
    keyframe,
    map_id,
    record,
    spatial,
    temporal,
    vertex,
    vertex_id,
)

ALL = GraphQuery()
YARD = GraphQuery(environment="yard")


def put(store: Store, commits: list[Commit]) -> None:
    for commit in commits:
        store.commit(commit)


def state(store: Store) -> tuple[object, ...]:
    """All that can be asked of the environment 'yard'."""
    topology = store.topology(YARD)
    wanted = [VertexId(m.record.id, i) for m in topology.maps for i in range(m.vertices)]
    keyframes = store.submap(GraphQuery(vertices=wanted)) if wanted else None
    return store.maps(ALL).model_dump_json(), topology.model_dump_json(), keyframes and keyframes.model_dump_json()


def test_a_drive_is_there_as_it_was_committed(store: Store) -> None:
    put(store, drive(0, 5))
    (summary,) = store.maps(ALL).maps
    assert summary.record == record(0)
    assert (summary.vertices, summary.finished) == (5, True)
    assert summary.length == pytest.approx(4 * 0.5)
    assert 5 * 1000 < summary.bytes < 5 * 3000
    wanted = [vertex_id(0, 3), vertex_id(0, 1)]
    found = store.submap(GraphQuery(vertices=wanted)).vertices
    assert [v.id for v in found] == wanted
    assert [v.stamp for v in found] == [3, 1]
    for stored, index in zip(found, (3, 1), strict=True):
        assert stored.keyframe.thumbnail == b"jpeg"
        for name, array in keyframe(0, index).arrays.items():
            assert np.array_equal(stored.keyframe.arrays[name], array)
    assert len(store.submap(GraphQuery(map=map_id(0))).vertices) == 5


def test_the_topology_is_the_pose_graph(store: Store) -> None:
    put(store, drive(0, 5))
    put(store, drive(1, 3, generation=1))
    store.commit(Commit(edges=[spatial(vertex_id(1, 2), vertex_id(0, 4))]))
    store.name_place(NamePlace(environment="yard", place="barn", vertex=vertex_id(0, 4)))
    graph = from_topology(store.topology(YARD))
    assert check(graph) == []
    assert len(graph) == 8
    assert graph.places == {"barn": vertex_id(0, 4)}
    assert graph.neighbours(vertex_id(0, 4), spatial=True) == [vertex_id(1, 2)]
    assert np.allclose(graph.transform(vertex_id(0, 0), vertex_id(0, 1)).T, geometry.from_xy_yaw(0.5, 0, 0.1))
    assert not graph.privileged(vertex_id(1, 0))


def test_environments_are_apart(store: Store) -> None:
    put(store, drive(0, 3))
    put(store, drive(1, 2, environment="field"))
    assert [m.record.id for m in store.maps(GraphQuery(environment="field")).maps] == [map_id(1)]
    assert len(store.maps(ALL).maps) == 2
    assert len(store.topology(GraphQuery(environment="field")).edges) == 1
    assert store.topology(GraphQuery(environment="moon")).maps == []
    assert store.topology(GraphQuery(map=map_id(1))).environment == "field"
    with pytest.raises(GraphError, match="name an environment: the store has field, yard"):
        store.topology(ALL)
    with pytest.raises(GraphError, match="belongs to environment 'yard'"):
        store.maps(GraphQuery(environment="field", map=map_id(0)))
    with pytest.raises(GraphError, match="two environments"):
        store.commit(Commit(edges=[spatial(vertex_id(0, 0), vertex_id(1, 0))]))


def test_the_only_environment_need_not_be_named(store: Store) -> None:
    with pytest.raises(GraphError, match="no maps"):
        store.topology(ALL)
    put(store, drive(0, 2))
    assert store.topology(ALL).environment == "yard"


@settings(max_examples=8, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(seed=st.integers(0, 2**32))
def test_commits_sent_again_in_any_later_order_change_nothing(
    seed: int, tmp_path_factory: pytest.TempPathFactory
) -> None:
    rng = np.random.default_rng(seed)
    store = Store(tmp_path_factory.mktemp("again") / "maps.sqlite")
    commits = [*drive(0, 4), *drive(1, 3, finished=False)]
    commits.append(Commit(edges=[spatial(vertex_id(1, 0), vertex_id(0, 2))]))
    for number, commit in enumerate(commits):
        assert store.commit(commit).text == "committed"
        before = state(store)
        for again in rng.integers(0, number + 1, 2):
            assert store.commit(commits[again]).text == "stored already"
        assert state(store) == before
    store.close()


CONTRADICTIONS = {
    "stored already with another record": Commit(map=record(0).model_copy(update={"stamp": 99})),
    "stored already with other content": Commit(
        vertex=vertex(1, 1).model_copy(update={"keyframe": keyframe(9, 9)}), edges=[temporal(1, 1)]
    ),
    "1 is stored already": Commit(vertex=vertex(1, 1).model_copy(update={"stamp": 4})),
    "the store has no map": Commit(vertex=vertex(7, 0)),
    "leaves a gap: the next vertex of its map is 2": Commit(vertex=vertex(1, 3)),
    "its map is finished": Commit(vertex=vertex(0, 3), edges=[temporal(0, 3)]),
    "has no vertex .*:8: its map has 3 vertices": Commit(edges=[spatial(vertex_id(0, 1), vertex_id(0, 8))]),
    "has no vertex": Commit(edges=[spatial(vertex_id(0, 1), vertex_id(0, 2**31 - 1))]),
    "joined already": Commit(edges=[temporal(1, 1, metres=0.6)]),
    "are joined already by another": Commit(edges=[spatial(vertex_id(1, 1), vertex_id(1, 0))]),
    "to itself": Commit(edges=[spatial(vertex_id(1, 1), vertex_id(1, 1))]),
    "do not follow each other": Commit(
        edges=[spatial(vertex_id(0, 0), vertex_id(1, 1)).model_copy(update={"kind": "temporal"})]
    ),
    "the store has no map .*7": Commit(finished=map_id(7)),
    # The first parts of these are sound, and must not stay behind.
    "the next vertex of its map is 0": Commit(map=record(8), vertex=vertex(8, 1)),
    "has no vertex .*:0": Commit(map=record(8), edges=[spatial(vertex_id(0, 0), vertex_id(8, 0))]),
    "has no map .*9": Commit(vertex=vertex(1, 2), edges=[temporal(1, 2)], finished=map_id(9)),
}


@pytest.mark.parametrize("sentence", CONTRADICTIONS)
def test_a_contradiction_is_refused_and_nothing_is_changed(store: Store, sentence: str) -> None:
    put(store, [*drive(0, 3), *drive(1, 2, finished=False)])
    before = state(store)
    with pytest.raises(GraphError, match=sentence):
        store.commit(CONTRADICTIONS[sentence])
    assert state(store) == before
    put(store, [Commit(vertex=vertex(1, 2), edges=[temporal(1, 2)])])


def test_a_temporal_edge_does_not_come_to_a_finished_map_but_a_spatial_one_does(store: Store) -> None:
    put(store, [Commit(map=record(0), vertex=vertex(0, 0)), Commit(vertex=vertex(0, 1)), Commit(vertex=vertex(0, 2))])
    store.commit(Commit(edges=[temporal(0, 1)], finished=map_id(0)))
    with pytest.raises(GraphError, match="its map is finished"):
        store.commit(Commit(edges=[temporal(0, 2)]))
    assert store.commit(Commit(edges=[spatial(vertex_id(0, 0), vertex_id(0, 2))])).text == "committed"


def test_a_drive_that_broke_off_is_used_and_can_go_on(tmp_path: Path) -> None:
    file = tmp_path / "maps.sqlite"
    first = Store(file)
    put(first, drive(0, 3, finished=False))
    first.close()
    second = Store(file)
    (summary,) = second.maps(YARD).maps
    assert (summary.vertices, summary.finished) == (3, False)
    assert check(from_topology(second.topology(YARD))) == []
    second.commit(Commit(vertex=vertex(0, 3), edges=[temporal(0, 3)], finished=map_id(0)))
    assert second.maps(YARD).maps[0].vertices == 4
    second.close()


def test_a_place_is_named_and_moved(store: Store) -> None:
    put(store, drive(0, 3))
    for index in (0, 2, 2):
        store.name_place(NamePlace(environment="yard", place="barn", vertex=vertex_id(0, index)))
        assert store.topology(YARD).places == {"barn": vertex_id(0, index)}
    with pytest.raises(GraphError, match="no vertex"):
        store.name_place(NamePlace(environment="yard", place="barn", vertex=vertex_id(0, 3)))
    with pytest.raises(GraphError, match="environment 'yard', not 'field'"):
        store.name_place(NamePlace(environment="field", place="barn", vertex=vertex_id(0, 0)))
    assert store.topology(YARD).places == {"barn": vertex_id(0, 2)}


def test_a_removed_map_takes_its_edges_and_places_with_it(store: Store) -> None:
    put(store, [*drive(0, 4), *drive(1, 3)])
    without = state(store)
    put(store, drive(2, 3))
    store.commit(Commit(edges=[spatial(vertex_id(2, 0), vertex_id(0, 1)), spatial(vertex_id(1, 2), vertex_id(2, 2))]))
    store.name_place(NamePlace(environment="yard", place="barn", vertex=vertex_id(2, 2)))
    text = store.remove(GraphQuery(map=map_id(2))).text
    assert text == f"removed map {map_id(2)}: 3 vertices, 2 edges to other maps, and its places barn"
    assert state(store) == without
    with pytest.raises(GraphError, match="no map"):
        store.remove(GraphQuery(map=map_id(2)))
    with pytest.raises(GraphError, match="no map"):
        store.submap(GraphQuery(vertices=[vertex_id(2, 0)]))
    put(store, drive(2, 3))


@pytest.mark.parametrize(
    "query", [ALL, YARD, GraphQuery(vertices=[vertex_id(0, 0)]), GraphQuery(environment="field", map=map_id(0))]
)
def test_only_one_named_map_is_ever_removed(store: Store, query: GraphQuery) -> None:
    put(store, drive(0, 2))
    with pytest.raises(GraphError):
        store.remove(query)
    assert store.maps(ALL).maps[0].vertices == 2


def test_a_submap_names_what_it_is_of(store: Store) -> None:
    put(store, drive(0, 2))
    store.commit(Commit(map=record(1)))
    for query in (ALL, YARD, GraphQuery(map=map_id(1)), GraphQuery(map=map_id(5)), GraphQuery(vertices=[("x", 0)])):
        with pytest.raises(GraphError):
            store.submap(query)


def test_a_map_too_large_for_one_answer_is_asked_for_by_its_vertices(store: Store) -> None:
    store.commit(Commit(map=record(0), vertex=vertex(0, 0)))
    with store._database.writing() as db:
        db.execute("UPDATE maps SET vertices = 257")
    with pytest.raises(GraphError, match="257 vertices, and a submap 1 to 256"):
        store.submap(GraphQuery(map=map_id(0)))


def test_an_empty_commit_is_answered(store: Store) -> None:
    assert store.commit(Commit()).text == "stored already"


def test_maps_are_listed_oldest_first(store: Store) -> None:
    for number in (2, 0, 1):
        put(store, drive(number, 1))
    assert [m.record.stamp for m in store.maps(ALL).maps] == [0, 1, 2]
    topology: Topology = store.topology(YARD)
    assert [m.record.stamp for m in topology.maps] == [0, 1, 2]
