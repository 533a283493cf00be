"""What places look like: stored beside the keyframes, given in pages, and filled in for stores that had none."""

from __future__ import annotations

import sqlite3
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from common import wire
from common.errors import GraphError
from common.messages import AppearanceQuery, Appearances, Commit, GraphQuery, Keyframe, VertexRecord
from services.mapstore import appearance
from services.mapstore.schema import MIGRATIONS, migrate
from services.mapstore.store import Store
from tests.services.mapstore.graphs import drive, map_id, temporal, vertex

YARD = AppearanceQuery(environment="yard")
Descriptors = NDArray[np.uint8]


def looks(number: int, index: int, count: int = 5) -> Descriptors:
    return np.random.default_rng([number, index, 7]).integers(0, 256, (count, 32), dtype=np.uint8)


def seen(number: int, index: int, **streams: Descriptors) -> VertexRecord:
    """A vertex with what it looks like in some streams."""
    plain = vertex(number, index)
    keyframe = plain.keyframe.model_copy(update={"appearance": streams})
    return plain.model_copy(update={"keyframe": keyframe})


def put(store: Store, number: int, count: int, **fields: object) -> None:
    for index, commit in enumerate(drive(number, count, finished=False, **fields)):  # type: ignore[arg-type]
        store.commit(commit.model_copy(update={"vertex": seen(number, index, plain=looks(number, index))}))


def everything(store: Store, query: AppearanceQuery = YARD) -> dict[tuple[str, int], dict[str, Descriptors]]:
    """All pages, put together as a reader does it."""
    found: dict[tuple[str, int], dict[str, Descriptors]] = {}
    known = dict(query.known)
    while True:
        page = wire.decode(Appearances, wire.encode(store.appearances(query.model_copy(update={"known": known}))))
        for j, (k, index) in enumerate(page.vertices.tolist()):
            name = page.maps[k].id
            known[name] = index + 1
            found[name, index] = {}
            for stream, counts in page.counts.items():
                begin = int(counts[:j].sum())
                found[name, index][stream] = page.descriptors[stream][begin : begin + counts[j]]
        if not page.more:
            return found


def test_each_vertex_has_its_own_descriptors_in_each_stream(store: Store) -> None:
    put(store, 0, 3)
    store.commit(Commit(vertex=seen(0, 3, plain=looks(0, 3), invariant=looks(1, 3, count=2)), edges=[temporal(0, 3)]))
    put(store, 1, 2)
    put(store, 2, 2, environment="field")
    found = everything(store)
    assert list(found) == [(map_id(0), i) for i in range(4)] + [(map_id(1), i) for i in range(2)]
    for (name, index), streams in found.items():
        assert np.array_equal(streams["plain"], looks(0 if name == map_id(0) else 1, index))
    assert np.array_equal(found[map_id(0), 3]["invariant"], looks(1, 3, count=2))
    assert len(found[map_id(0), 2]["invariant"]) == 0


def test_only_what_is_not_known_is_given(store: Store) -> None:
    put(store, 0, 4)
    put(store, 1, 2)
    known = {map_id(0): 3, map_id(1): 2, map_id(9): 5}
    page = store.appearances(AppearanceQuery(environment="yard", known=known))
    assert page.vertices.tolist() == [[0, 3]]
    assert [record.id for record in page.maps] == [map_id(0), map_id(1)]
    assert not page.more
    assert store.appearances(AppearanceQuery(environment="moon")).maps == []


def test_a_large_answer_comes_in_pages(store: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(appearance, "PAGE_BYTES", 3 * 5 * 32)
    put(store, 0, 7)
    put(store, 1, 4)
    first = store.appearances(YARD)
    assert (len(first.vertices), first.more) == (3, True)
    assert len(everything(store)) == 11


def test_a_submap_comes_without_it(store: Store) -> None:
    put(store, 0, 2)
    assert not any(stored.keyframe.appearance for stored in store.submap(GraphQuery(map=map_id(0))).vertices)


def test_other_looks_under_a_stored_vertex_are_refused(store: Store) -> None:
    put(store, 0, 2)
    same = Commit(vertex=seen(0, 1, plain=looks(0, 1)), edges=[temporal(0, 1)])
    assert store.commit(same).text == "stored already"
    for other in (seen(0, 1), seen(0, 1, plain=looks(5, 5)), seen(0, 1, invariant=looks(0, 1))):
        with pytest.raises(GraphError, match="stored already with other content"):
            store.commit(Commit(vertex=other))


def test_a_removed_map_is_no_longer_recognised(store: Store) -> None:
    put(store, 0, 3)
    put(store, 1, 2)
    store.remove(GraphQuery(map=map_id(0)))
    assert list(everything(store)) == [(map_id(1), 0), (map_id(1), 1)]


def of_version_1(file: Path, keyframes: list[dict[str, NDArray[np.generic]] | None]) -> None:
    """A store as the first version made it: one map whose keyframes have these arrays, None for a spoilt one."""
    db = sqlite3.connect(file, isolation_level=None)
    migrate(db, MIGRATIONS[:1])
    db.execute(
        "INSERT INTO maps (number, id, environment, stamp, robot, sensor, generation, finished, vertices) "
        "VALUES (1, ?, 'yard', 0, 'r1', 'front', 0, 1, ?)",
        (map_id(0), len(keyframes)),
    )
    for index, arrays in enumerate(keyframes):
        content = b"spoilt" if arrays is None else wire.encode(Keyframe(pipeline="stereo", arrays=arrays))
        db.execute("INSERT INTO vertices VALUES (?, 1, ?, 0)", (index + 1, index))
        db.execute("INSERT INTO keyframes VALUES (?, 0, ?)", (index + 1, content))
    db.close()


def test_a_store_of_the_first_version_gets_them_from_its_keyframes(tmp_path: Path) -> None:
    file = tmp_path / "maps.sqlite"
    many, few = looks(0, 0, count=600), looks(0, 1, count=30)
    of_version_1(
        file,
        [
            {"plain/descriptors": many, "plain/depths": np.ones(600, np.float32)},
            {"plain/descriptors": few},
            None,
            {"points": np.eye(3)},
            {"plain/descriptors": np.zeros((4, 16), np.uint8)},
        ],
    )
    store = Store(file)
    found = everything(store)
    assert len(found) == 5
    kept = found[map_id(0), 0]["plain"]
    assert len(kept) == 200
    assert np.array_equal(kept[[0, -1]], many[[0, -1]])
    assert {row.tobytes() for row in kept} <= {row.tobytes() for row in many}
    assert np.array_equal(found[map_id(0), 1]["plain"], few)
    assert all(len(found[map_id(0), index]["plain"]) == 0 for index in (2, 3, 4))
    assert store.appearances(AppearanceQuery(environment="yard", known={map_id(0): 5})).vertices.tolist() == []
    store.close()
    again = Store(file)
    assert everything(again).keys() == found.keys()
    assert again.commit(drive(1, 1)[0]).text == "committed"
    again.close()
