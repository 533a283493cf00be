"""A map as a file: the same map again on another robot, and nothing of a file that is not sound."""

from __future__ import annotations

import io
import json
import pickle
import sqlite3
import zipfile

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from common import wire
from common.errors import GraphError
from common.ids import VertexId
from common.messages import Commit, GraphQuery, MapEnds, SyncState
from services.mapstore.archive import ArchiveError, import_archive, verify, write_archive
from services.mapstore.schema import MIGRATIONS, migrate
from services.mapstore.settings import Settings
from services.mapstore.store import Store
from tests.services.mapstore.graphs import drive, map_id, record, spatial, temporal, vertex_id


def other_store(folder):
    return Store(folder / "maps.sqlite", Settings(reserve_mb=0))


def fill(store, number=1, count=5, **fields):
    for commit in drive(number, count, **fields):
        store.commit(commit)
    store.ends(MapEnds(map=map_id(number), start_place="gate", end_place="yard"))


@pytest.fixture
def archived(store, tmp_path):
    fill(store)
    file = tmp_path / "one.zip"
    return store, file, write_archive(store, map_id(1), file)


def contents(store, number=1):
    summary = store.summary(map_id(number))
    vertices = [store.whole_vertex(vertex_id(number, k)) for k in range(summary.vertices)]
    return [bytes_of(v) for v in vertices], [bytes_of(e) for e in store.edges_of(map_id(number))]


def bytes_of(message):
    return wire.encode(message)


def test_another_robot_gets_the_same_map(archived, tmp_path):
    store, file, archive = archived
    other = other_store(tmp_path / "other")
    summary = import_archive(other, file, archive, map_id(1))
    assert (summary.start_place, summary.end_place, summary.sync) == ("gate", "yard", SyncState.FETCHED)
    assert summary.length == store.summary(map_id(1)).length
    assert contents(other) == contents(store)
    assert import_archive(other, file, archive) == summary


def test_the_same_map_gives_the_same_bytes(archived, tmp_path):
    store, file, archive = archived
    assert write_archive(store, map_id(1), tmp_path / "two.zip") == archive
    assert (tmp_path / "two.zip").read_bytes() == file.read_bytes()
    other = other_store(tmp_path / "other")
    import_archive(other, file)
    assert write_archive(other, map_id(1), tmp_path / "three.zip") == archive


def test_a_map_that_is_not_finished_has_no_archive(store, tmp_path):
    for commit in drive(1, 3, finished=False):
        store.commit(commit)
    with pytest.raises(GraphError, match="not finished"):
        write_archive(store, map_id(1), tmp_path / "one.zip")
    assert not list(tmp_path.glob("*.zip*"))


def test_an_import_that_was_killed_is_invisible_and_goes_on(archived, tmp_path):
    store, file, archive = archived
    other = other_store(tmp_path / "other")

    def killed(_count):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        import_archive(other, file, archive, advance=killed)
    assert other.maps(GraphQuery()).maps == []
    assert other.topology(GraphQuery(environment="yard")).maps == []
    import_archive(other, file, archive)
    assert contents(other) == contents(store)


def test_edges_to_a_map_that_is_elsewhere_wait_for_it(store, tmp_path):
    fill(store, 1)
    for commit in drive(2, 5, generation=1):
        store.commit(commit)
    store.commit(Commit(edges=[spatial(vertex_id(2, 3), vertex_id(1, 2))]))
    store.ends(MapEnds(map=map_id(2)))
    for number in (1, 2):
        write_archive(store, map_id(number), tmp_path / f"{number}.zip")
    other = other_store(tmp_path / "other")
    import_archive(other, tmp_path / "2.zip")
    assert not other.topology(GraphQuery(environment="yard")).spatial.any()
    import_archive(other, tmp_path / "1.zip")
    assert other.topology(GraphQuery(environment="yard")).spatial.sum() == 1
    other.make_room(map_id(1))
    assert not other.topology(GraphQuery(environment="yard")).spatial.any()
    import_archive(other, tmp_path / "1.zip")
    assert contents(other, 2) == contents(store, 2)


def changed(file, change):
    """A copy of an archive whose members were changed."""
    with zipfile.ZipFile(file) as old:
        members = {info.filename: old.read(info) for info in old.infolist()}
    with zipfile.ZipFile(file, "w") as new:
        change(members, new)
        for name, content in members.items():
            new.writestr(plain(name), content)


def plain(name):
    """A member's fields as archives have them."""
    info = zipfile.ZipInfo(name)
    info.create_system, info.external_attr = 3, 0o100644 << 16
    return info


def add_path_above(_members, new):
    new.writestr(plain("../../evil.bin"), b"evil")


def add_pickle(members, _new):
    members["vertices/000001.bin"] = pickle.dumps(["evil"])


def add_bomb(members, new):
    content = members.pop("vertices/000002.bin")
    new.writestr(plain("vertices/000002.bin"), bytes(len(content)), zipfile.ZIP_DEFLATED)


def add_twin(members, new):
    new.writestr(plain("vertices/000001.bin"), members["vertices/000001.bin"])


def drop_vertex(members, _new):
    del members["vertices/000003.bin"]


def drop_manifest(members, _new):
    del members["manifest.json"]


def newer_format(members, _new):
    members["manifest.json"] = json.dumps(json.loads(members["manifest.json"]) | {"format": 2}).encode()


def swap_vertices(members, _new):
    manifest = json.loads(members["manifest.json"])
    a, b = "vertices/000001.bin", "vertices/000002.bin"
    members[a], members[b] = members[b], members[a]
    rows = {row["name"]: row for row in manifest["members"]}
    rows[a]["sha256"], rows[b]["sha256"] = rows[b]["sha256"], rows[a]["sha256"]
    members["manifest.json"] = json.dumps(manifest).encode()


@pytest.mark.filterwarnings("ignore:Duplicate name")
@pytest.mark.parametrize(
    ("change", "words"),
    [
        (add_path_above, "'../../evil.bin' would lie outside of it"),
        (add_pickle, "vertices/000001.bin"),
        (add_bomb, "is compressed, and may hide any size"),
        (add_twin, "two of its members have one name"),
        (drop_vertex, "vertices/000003.bin is missing"),
        (drop_manifest, "no manifest.json"),
        (newer_format, "'format'"),
        (swap_vertices, "holds vertex"),
    ],
)
def test_what_is_wrong_is_said_and_nothing_is_taken(archived, tmp_path, change, words):
    _, file, _ = archived
    changed(file, change)
    other = other_store(tmp_path / "other")
    before = sorted(tmp_path.rglob("*"))
    with pytest.raises(ArchiveError, match="fetch or export it again") as error:
        import_archive(other, file)
    assert words in str(error.value)
    assert other.maps(GraphQuery()).maps == []
    assert sorted(tmp_path.rglob("*")) == before


def test_another_map_or_another_sum_is_refused(archived):
    _, file, archive = archived
    with pytest.raises(ArchiveError, match="it is of map"):
        verify(file, archive, map_id(2))
    with pytest.raises(ArchiveError, match="another sum"):
        verify(file, archive.model_copy(update={"sha256": "0" * 64}))
    file.write_bytes(file.read_bytes()[:-9])
    with pytest.raises(ArchiveError):
        verify(file)


@settings(max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(place=st.floats(0, 1, exclude_max=True), bit=st.integers(0, 7))
def test_a_flipped_bit_is_noticed_wherever_it_is(archived, tmp_path, place, bit):
    _, file, archive = archived
    content = bytearray(file.read_bytes())
    content[int(place * len(content))] ^= 1 << bit
    spoilt = tmp_path / "spoilt.zip"
    spoilt.write_bytes(content)
    with pytest.raises(ArchiveError):
        verify(spoilt, archive)
    with pytest.raises(ArchiveError):
        verify(spoilt)


@given(content=st.binary(max_size=300))
@settings(max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_noise_is_no_archive(tmp_path, content):
    file = tmp_path / "noise.zip"
    file.write_bytes(content)
    with pytest.raises(ArchiveError):
        verify(file)


def test_an_empty_zip_is_no_archive(tmp_path):
    buffer = io.BytesIO()
    zipfile.ZipFile(buffer, "w").close()
    (tmp_path / "empty.zip").write_bytes(buffer.getvalue())
    with pytest.raises(ArchiveError, match="no manifest"):
        verify(tmp_path / "empty.zip")


def test_ends_of_a_taught_map_without_names_are_its_vertices(store):
    for commit in drive(1, 4):
        store.commit(commit)
    store.ends(MapEnds(map=map_id(1), end_place="yard"))
    summary = store.summary(map_id(1))
    assert (summary.start_place, summary.end_place) == (str(VertexId(map_id(1), 0)), "yard")
    assert summary.sync is SyncState.WAITING
    store.ends(MapEnds(map=map_id(1), end_place="yard"))
    with pytest.raises(GraphError, match="cannot be told other ends"):
        store.ends(MapEnds(map=map_id(1), end_place="shed"))
    assert [found.record.id for found in store.to_share("r1")] == [map_id(1)]


def test_a_map_in_the_making_has_no_ends(store):
    for commit in drive(1, 4, finished=False):
        store.commit(commit)
    with pytest.raises(GraphError, match="not finished"):
        store.ends(MapEnds(map=map_id(1)))


def test_edges_of_a_store_of_version_3_stay_part_of_the_younger_map_s_archive(tmp_path):
    file = tmp_path / "maps.sqlite"
    db = sqlite3.connect(file, isolation_level=None)
    migrate(db, MIGRATIONS[:3])
    for number in (1, 2):
        r = record(number)
        db.execute(
            "INSERT INTO maps (number, id, environment, stamp, robot, sensor, generation, finished, sealed, vertices) "
            "VALUES (?, ?, ?, ?, ?, ?, 0, 1, 1, 2)",
            (number, r.id, r.environment, r.stamp, r.robot, r.sensor),
        )
        for index in range(2):
            db.execute("INSERT INTO vertices VALUES (?, ?, ?, 0)", (10 * number + index, number, index))
        edge = temporal(number, 1)
        ends = (10 * number, 10 * number + 1, 0, edge.T_a_b.tobytes(), edge.covariance.tobytes())
        db.execute("INSERT INTO edges VALUES (?, ?, ?, ?, ?)", ends)
    db.execute("INSERT INTO edges VALUES (10, 20, 1, ?, ?)", ends[3:])
    db.execute("INSERT INTO waiting_edges VALUES (?, 0, ?, 0, ?, ?)", (map_id(2), map_id(9), *ends[3:]))
    db.close()
    store = other_store(tmp_path)
    assert [edge.kind for edge in store.edges_of(map_id(1))] == ["temporal"]
    assert [edge.kind for edge in store.edges_of(map_id(2))] == ["temporal", "spatial"]
    store.close()
