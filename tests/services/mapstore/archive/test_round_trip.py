"""A map that goes from one store to another is the same map, and its archive always the same file."""

from __future__ import annotations

import errno
import json
import os
import zipfile
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from common import wire
from common.errors import GraphError
from common.ids import VertexId
from common.messages import (
    AppearanceQuery,
    Commit,
    EdgeRecord,
    GraphQuery,
    MapEnds,
    NamePlace,
    SyncState,
    VertexRecord,
)
from common.posegraph import check, from_topology
from services.mapstore.archive import ArchiveReader, import_archive, importing, write_archive
from services.mapstore.archive.writing import checked_sum
from services.mapstore.errors import StoreError
from services.mapstore.store import Store
from tests.services.mapstore.archive.conftest import REPEATED, SETTINGS, TAUGHT, Archived
from tests.services.mapstore.graphs import drive, keyframe, map_id, record, spatial, temporal, vertex, vertex_id

YARD = GraphQuery(environment="yard")


def contents(store: Store) -> tuple[object, ...]:
    """All that can be asked of the environment 'yard', but for how far its maps are shared."""
    topology = store.topology(YARD)
    wanted = [VertexId(m.record.id, i) for m in topology.maps for i in range(m.vertices)]
    same = topology.model_copy(
        update={"places": {}, "maps": [m.model_copy(update={"sync": SyncState.LOCAL}) for m in topology.maps]}
    )
    edges = sorted(
        (same.maps[k].record.id, i, same.maps[n].record.id, j, T.tobytes())
        for (k, i, n, j), T in zip(same.edges.tolist(), same.T_a_b, strict=True)
    )
    looks = store.appearances(AppearanceQuery(environment="yard"))
    vertices = store.submap(GraphQuery(vertices=wanted)).model_dump_json() if wanted else None
    return same.model_copy(update={"edges": np.zeros((0, 4), np.int32), "spatial": np.zeros(0), "T_a_b":
        np.zeros((0, 4, 4)), "covariances": np.zeros((0, 6, 6))}).model_dump_json(), edges, vertices, \
        looks.model_dump_json()  # fmt: skip


def test_both_maps_arrive_whole_in_either_order(
    driven: Store, other: Store, taught: Archived, repeated: Archived
) -> None:
    for archived, number in ((repeated, REPEATED), (taught, TAUGHT)):
        summary = import_archive(other, archived.file, archived.archive, map_id(number))
        assert summary.record.id == map_id(number)
        assert summary.finished
        assert summary.sync is SyncState.FETCHED
    assert check(from_topology(other.topology(YARD))) == []
    assert contents(other) == contents(driven)
    graph = from_topology(other.topology(YARD))
    assert graph.neighbours(vertex_id(TAUGHT, 2), spatial=True) == [vertex_id(REPEATED, 2)]
    assert (summary.start_place, summary.end_place) == ("barn", "gate")
    assert other.to_share("r1") == []


def test_an_archive_is_the_same_file_whenever_and_wherever_it_is_written(
    driven: Store, other: Store, taught: Archived, repeated: Archived, tmp_path: Path
) -> None:
    again = tmp_path / "again.zip"

    def same(store: Store) -> bool:
        return all(
            write_archive(store, map_id(number), again) == archived.archive
            and again.read_bytes() == archived.file.read_bytes()
            for number, archived in ((TAUGHT, taught), (REPEATED, repeated))
        )

    assert same(driven)
    # What comes after the sealing is the robot's alone.
    driven.commit(Commit(edges=[spatial(vertex_id(REPEATED, 4), vertex_id(TAUGHT, 5))]))
    driven.name_place(NamePlace(environment="yard", place="pond", vertex=vertex_id(TAUGHT, 1)))
    driven.set_sync(map_id(TAUGHT), SyncState.SYNCED)
    assert same(driven)
    for archived in (repeated, taught):
        import_archive(other, archived.file, archived.archive)
    assert same(other)
    other.remove(GraphQuery(map=map_id(TAUGHT)))
    assert write_archive(other, map_id(REPEATED), again) == repeated.archive
    import_archive(other, taught.file, taught.archive)
    assert same(other)
    assert contents(other) != contents(driven)


def test_half_a_map_is_seen_by_nobody_and_completed_by_reading_again(
    other: Store, taught: Archived, repeated: Archived, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(importing, "_AT_A_TIME", 2)
    import_archive(other, repeated.file, None)
    before, stops = contents(other), 0
    steps = ("begin_arrival", "arrive", "join_arrival", "finish_arrival")
    real = {name: getattr(other, name) for name in steps}
    while stops < 20:
        left = iter(range(stops))

        def some(*part: object, name: str, left: Iterator[int] = left) -> object:
            if next(left, None) is None:
                raise StoreError("the power is cut")
            return real[name](*part)

        for name in steps:
            monkeypatch.setattr(other, name, partial(some, name=name))
        try:
            import_archive(other, taught.file, taught.archive)
            break
        except StoreError:
            stops += 1
            assert contents(other) == before
            assert other.to_share("r1") == []
            with pytest.raises(GraphError, match="no map"):
                other.submap(GraphQuery(vertices=[vertex_id(TAUGHT, 0)]))
    assert stops >= 5
    assert len(other.maps(YARD).maps) == 2
    assert check(from_topology(other.topology(YARD))) == []


def test_half_a_map_makes_room_for_others_and_its_reader_is_told(other: Store, taught: Archived) -> None:
    assert other.begin_arrival(record(TAUGHT))
    other.arrive([vertex(TAUGHT, 0)])
    (half,) = other.removable()
    assert not half.finished
    other.make_room(half.record.id)
    assert other.counts() == (0, 0, 0)
    for step in (
        lambda: other.arrive([vertex(TAUGHT, 1)]),
        lambda: other.join_arrival(map_id(TAUGHT), [temporal(TAUGHT, 1)]),
        lambda: other.finish_arrival(MapEnds(map=map_id(TAUGHT)), SyncState.FETCHED),
    ):
        with pytest.raises(StoreError, match="removed while it arrived"):
            step()
    import_archive(other, taught.file, None)


def test_an_edge_that_was_found_here_comes_back_with_the_map(
    driven: Store, other: Store, taught: Archived, repeated: Archived
) -> None:
    del driven
    import_archive(other, taught.file)
    import_archive(other, repeated.file)
    joint = spatial(vertex_id(TAUGHT, 5), vertex_id(REPEATED, 4), 0.3)
    other.commit(Commit(edges=[joint]))
    other.make_room(map_id(REPEATED))
    import_archive(other, repeated.file)
    assert from_topology(other.topology(YARD)).neighbours(vertex_id(TAUGHT, 5), spatial=True) == [
        vertex_id(REPEATED, 4)
    ]


def test_a_clock_that_was_set_back_before_a_repeat_takes_no_edge_from_it(store: Store, tmp_path: Path) -> None:
    """The repeat's id is then older than its parent's, which may have been shared long ago."""
    for commit in [*drive(5, 4), *drive(1, 3)]:
        store.commit(commit)
    store.ends(MapEnds(map=map_id(5)))
    parent = write_archive(store, map_id(5), tmp_path / "5.zip")
    store.commit(Commit(edges=[spatial(vertex_id(5, 1), vertex_id(1, 1))]))
    store.ends(MapEnds(map=map_id(1)))
    write_archive(store, map_id(1), tmp_path / "1.zip")
    with ArchiveReader(tmp_path / "1.zip") as archive:
        assert [edge.kind for some in archive.edges() for edge in some] == ["temporal", "temporal", "spatial"]
    assert write_archive(store, map_id(5), tmp_path / "5.zip") == parent


def test_edges_wait_for_a_map_that_was_removed_and_join_it_again(driven: Store, tmp_path: Path) -> None:
    driven.commit(Commit(edges=[spatial(vertex_id(REPEATED, 4), vertex_id(TAUGHT, 5))]))
    before = contents(driven)
    file = tmp_path / "taught.zip"
    archive = write_archive(driven, map_id(TAUGHT), file)
    driven.remove(GraphQuery(map=map_id(TAUGHT)))
    assert len(driven.topology(YARD).edges) == 4
    import_archive(driven, file, archive)
    assert contents(driven) == before
    for number in (TAUGHT, REPEATED):
        driven.remove(GraphQuery(map=map_id(number)))
    import_archive(driven, file, archive)
    assert len(driven.topology(YARD).edges) == 5


def test_edges_to_a_map_of_another_environment_wait_for_ever(other: Store, repeated: Archived) -> None:
    for commit in drive(TAUGHT, 6, environment="field"):
        other.commit(commit)
    import_archive(other, repeated.file, None)
    assert len(other.topology(YARD).edges) == 4
    assert write_archive(other, map_id(REPEATED), repeated.file) == repeated.archive


def test_a_disk_that_takes_nothing_leaves_the_older_file(
    driven: Store, taught: Archived, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(_: int) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    before = taught.file.read_bytes()
    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OSError, match="No space left"):
        write_archive(driven, map_id(TAUGHT), taught.file)
    assert taught.file.read_bytes() == before
    assert [file.name for file in taught.file.parent.glob("*taught*")] == ["taught.zip"]


def test_any_zip_program_can_look_into_an_archive(taught: Archived) -> None:
    with zipfile.ZipFile(taught.file) as archive:
        names = archive.namelist()
        manifest = json.loads(archive.read("manifest.json"))
        first = wire.decode(VertexRecord, archive.read("vertices/000000.bin"))
    assert (manifest["map"]["id"], manifest["start_place"], manifest["vertices"]) == (map_id(TAUGHT), "barn", 6)
    assert [member["name"] for member in manifest["members"]] == names[:-1]
    assert np.array_equal(first.keyframe.arrays["descriptors"], keyframe(TAUGHT, 0).arrays["descriptors"])


def test_files_of_more_than_four_gigabytes_and_65535_members_are_read(
    driven: Store, other: Store, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(zipfile, "ZIP64_LIMIT", 8000)
    monkeypatch.setattr(zipfile, "ZIP_FILECOUNT_LIMIT", 3)
    file = tmp_path / "large.zip"
    archive = write_archive(driven, map_id(TAUGHT), file)
    assert b"PK\6\6" in file.read_bytes()
    assert import_archive(other, file, archive).vertices == 6
    assert write_archive(other, map_id(TAUGHT), file) == archive


EDGES = st.lists(st.tuples(st.integers(0, 4), st.integers(0, 1), st.integers(0, 4), st.booleans()), max_size=6)


@settings(max_examples=15, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(joints=EDGES, counts=st.tuples(st.integers(1, 5), st.integers(1, 5)), seed=st.integers(0, 2**32))
def test_any_two_maps_arrive_as_they_were(
    joints: list[tuple[int, int, int, bool]],
    counts: tuple[int, int],
    seed: int,
    tmp_path_factory: pytest.TempPathFactory,
) -> None:
    folder = tmp_path_factory.mktemp("maps")
    rng = np.random.default_rng(seed)
    source, target = (Store(folder / name / "maps.sqlite", SETTINGS) for name in ("a", "b"))
    for number, count in enumerate(counts):
        for commit in drive(number, count, size=int(rng.integers(0, 5000))):
            source.commit(commit)
    for a, to, b, turned in joints:
        ends = vertex_id(0, a % counts[0]), vertex_id(to, b % counts[to])
        edge: EdgeRecord = spatial(*(ends[::-1] if turned else ends))
        try:
            source.commit(Commit(edges=[edge]))
        except GraphError:
            continue
    archives = {}
    for number in (0, 1):
        archives[number] = write_archive(source, map_id(number), folder / f"{number}.zip")
    for number in rng.permutation(2).tolist():
        import_archive(target, folder / f"{number}.zip", archives[number])
        assert write_archive(target, map_id(number), folder / "again.zip") == archives[number]
    assert contents(target) == contents(source)
    assert checked_sum(folder / "again.zip") in archives.values()
    source.close()
    target.close()


def test_a_temporal_edge_that_runs_backwards_arrives(store: Store, other: Store, tmp_path: Path) -> None:
    forward = temporal(0, 1)
    backward = forward.model_copy(update={"a": forward.b, "b": forward.a})
    for commit in (Commit(map=drive(0, 1)[0].map, vertex=vertex(0, 0)), Commit(vertex=vertex(0, 1), edges=[backward])):
        store.commit(commit)
    store.commit(Commit(finished=map_id(0)))
    import_archive(other, tmp_path / "a.zip", write_archive(store, map_id(0), tmp_path / "a.zip"))
    assert contents(other) == contents(store)
