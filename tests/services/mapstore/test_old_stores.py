"""Stores that older programs left, kept as files: each opens, holds what it held, and takes and shares more."""

from __future__ import annotations

import gzip
import sqlite3
from pathlib import Path

import numpy as np
import pytest

from common.ids import VertexId
from common.messages import AppearanceQuery, Commit, GraphQuery, MapEnds, SyncState, VertexRecord
from services.mapstore.archive import verify, write_archive
from services.mapstore.schema import MIGRATIONS, migrate
from services.mapstore.settings import Settings
from services.mapstore.store import Store
from tests.data.stores.write_store import COUNTS, MAPS, drive, edge

KEPT = Path(__file__).resolve().parents[2] / "data" / "stores"
NAMES = sorted({path.name.split(".")[0] for path in KEPT.glob("*.gz")})
YARD = GraphQuery(environment="yard")


def unpack(name: str, folder: Path) -> Path:
    for path in KEPT.glob(f"{name}.sqlite*.gz"):
        (folder / path.name.removesuffix(".gz").replace(name, "maps")).write_bytes(gzip.decompress(path.read_bytes()))
    return folder / "maps.sqlite"


def version_of(file: Path) -> int:
    db = sqlite3.connect(file)
    version: int = db.execute("PRAGMA user_version").fetchone()[0]
    db.close()
    return version


@pytest.fixture(params=NAMES)
def old(request: pytest.FixtureRequest, tmp_path: Path) -> tuple[int, Path]:
    file = unpack(request.param, tmp_path)
    version = version_of(file)
    assert request.param.startswith(f"v{version}")
    return version, file


def test_there_is_a_store_of_every_version() -> None:
    assert {int(name[1]) for name in NAMES} == set(range(1, len(MIGRATIONS) + 1))


def test_an_old_store_holds_what_it_held_and_goes_on(old: tuple[int, Path], tmp_path: Path) -> None:
    version, file = old
    store = Store(file, Settings(reserve_mb=0))
    try:
        holds_what_it_held(store, version)
        goes_on(store, tmp_path)
    finally:
        store.close()
    assert version_of(file) == len(MIGRATIONS)


def holds_what_it_held(store: Store, version: int) -> None:
    summaries = {summary.record.id: summary for summary in store.maps(YARD).maps}
    assert [summaries[name].vertices for name in MAPS] == list(COUNTS)
    assert [summaries[name].finished for name in MAPS] == [True, False]
    graph = store.topology(YARD)
    assert graph.places == {"dock": VertexId(MAPS[0], 0), "gate": VertexId(MAPS[0], COUNTS[0] - 1)}
    assert sorted(graph.spatial.tolist()) == [0] * (sum(COUNTS) - 2) + [1]
    np.testing.assert_allclose(np.sort(graph.T_a_b[:, 0, 3]), [0.1] + [0.5] * (sum(COUNTS) - 2))
    for number in (0, 1):
        for commit in drive(number, COUNTS[number]):
            assert commit.vertex is not None
            same_vertex(store, commit.vertex)
    looks = store.appearances(AppearanceQuery(environment="yard"))
    assert len(looks.vertices) == sum(COUNTS)
    assert (looks.counts["plain"] > 0).all()
    assert summaries[MAPS[0]].sync is (SyncState.SYNCED if version >= 3 else SyncState.LOCAL)
    assert [r.speed for r in graph.restrictions] == ([0.4] if version >= 5 else [])


def same_vertex(store: Store, written: VertexRecord) -> None:
    (found,) = store.submap(GraphQuery(vertices=[written.id])).vertices
    assert found.stamp == written.stamp
    for name, array in written.keyframe.arrays.items():
        np.testing.assert_array_equal(found.keyframe.arrays[name], array)


def goes_on(store: Store, folder: Path) -> None:
    """The unfinished map is taught on, finished, and becomes an archive, as does the one from before."""
    for commit in drive(1, COUNTS[1] + 2)[COUNTS[1] :]:
        assert store.commit(commit).text == "committed"
    joint = edge("spatial", VertexId(MAPS[1], COUNTS[1]), VertexId(MAPS[0], 3), 0.1)
    store.commit(Commit(edges=[joint], finished=MAPS[1]))
    store.ends(MapEnds(map=MAPS[0], start_place="dock", end_place="gate"))
    store.ends(MapEnds(map=MAPS[1], start_place="dock", end_place="gate"))
    assert MAPS[1] in {summary.record.id for summary in store.to_share("r1")}
    for name in MAPS:
        archive = write_archive(store, name, folder / f"{name}.zip")
        assert verify(folder / f"{name}.zip", archive, name).map.id == name


@pytest.mark.parametrize("reached", range(1, len(MIGRATIONS)))
def test_an_upgrade_that_was_cut_off_goes_on_from_its_last_whole_step(tmp_path: Path, reached: int) -> None:
    file = unpack("v1", tmp_path)
    db = sqlite3.connect(file, isolation_level=None)
    migrate(db, MIGRATIONS[:reached])
    db.close()
    store = Store(file, Settings(reserve_mb=0))
    holds_what_it_held(store, 1)
    store.close()
