"""What was answered is there: after a killed writer, beside readers, on a full disk, and across versions."""

from __future__ import annotations

import os
import signal
import sqlite3
import subprocess
import sys
import threading
from pathlib import Path

import numpy as np
import pytest

from common.errors import GraphError, RetraverseError
from common.messages import Commit, GraphQuery, NamePlace
from common.posegraph import check, from_topology
from services.mapstore import database
from services.mapstore.errors import StoreError
from services.mapstore.schema import MIGRATIONS, migrate
from services.mapstore.settings import Settings
from services.mapstore.store import Store
from tests.services.mapstore.graphs import drive, keyframe, map_id, vertex_id

YARD = GraphQuery(environment="yard")
LARGE = 60_000

WRITER = """
import itertools, sys
from pathlib import Path
from services.mapstore.settings import Settings
from services.mapstore.store import Store
from tests.services.mapstore.graphs import drive
store = Store(Path(sys.argv[1]), Settings(checkpoint_mb=0.3))
for number in itertools.count(int(sys.argv[2])):
    for index, commit in enumerate(drive(number, 12, size={size})):
        store.commit(commit)
        store.checkpoint()
        print(number, index, flush=True)
"""


def kill_in_the_middle(file: Path, first_map: int, answers: int) -> list[tuple[int, int]]:
    """Lets a process commit, kills it while it does, and returns what had been answered."""
    command = [sys.executable, "-c", WRITER.format(size=LARGE), str(file), str(first_map)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        answered = [process.stdout.readline() for _ in range(answers)]
        process.send_signal(signal.SIGKILL)
        answered += process.stdout.readlines()
    return [(int(line.split()[0]), int(line.split()[1])) for line in answered if line.endswith("\n")]


def test_every_answered_commit_survives_kill_9_and_nothing_is_half(tmp_path: Path) -> None:
    file = tmp_path / "maps.sqlite"
    rng = np.random.default_rng(1)
    answered: list[tuple[int, int]] = []
    for attempt in range(4):
        answered += kill_in_the_middle(file, 100 * attempt, int(rng.integers(1, 40)))
        store = Store(file)
        graph = from_topology(store.topology(YARD))
        assert check(graph) == []
        for number, index in answered:
            if index == 12:
                assert graph.experience(map_id(number)).finished
                continue
            (stored,) = store.submap(GraphQuery(vertices=[vertex_id(number, index)])).vertices
            expected = keyframe(number, index, LARGE).arrays["descriptors"]
            assert np.array_equal(stored.keyframe.arrays["descriptors"], expected)
        store.close()
    assert len(answered) >= 4


def test_readers_see_whole_states_while_commits_go_on(store: Store) -> None:
    for commit in drive(0, 2, finished=False, size=20_000):
        store.commit(commit)
    done = threading.Event()
    failures: list[BaseException] = []

    def read() -> None:
        try:
            while not done.is_set():
                topology = store.topology(YARD)
                assert len(topology.edges) == topology.maps[0].vertices - 1
                assert topology.maps[0].length == pytest.approx(0.5 * len(topology.edges))
                last = vertex_id(0, topology.maps[0].vertices - 1)
                assert store.submap(GraphQuery(vertices=[last])).vertices[0].id == last
        except BaseException as error:  # noqa: BLE001, handed to the test's own thread
            failures.append(error)

    readers = [threading.Thread(target=read) for _ in range(3)]
    for reader in readers:
        reader.start()
    for commit in drive(0, 120, finished=False, size=20_000)[2:]:
        store.commit(commit)
        store.checkpoint()
    done.set()
    for reader in readers:
        reader.join()
    assert failures == []
    assert store.maps(YARD).maps[0].vertices == 120


def test_the_same_commits_from_several_threads_are_stored_once(store: Store) -> None:
    commits = drive(0, 30)

    def send() -> None:
        for commit in commits:
            store.commit(commit)

    senders = [threading.Thread(target=send) for _ in range(3)]
    for sender in senders:
        sender.start()
    for sender in senders:
        sender.join()
    (summary,) = store.maps(YARD).maps
    assert (summary.vertices, summary.finished) == (30, True)
    assert summary.length == pytest.approx(29 * 0.5)


def test_on_a_full_disk_a_commit_is_refused_whole_and_the_store_lives_on(store: Store) -> None:
    commits = drive(0, 40, size=LARGE)
    store.commit(commits[0])
    writer = store._database._writer
    pages = writer.execute("PRAGMA page_count").fetchone()[0]
    writer.execute(f"PRAGMA max_page_count = {pages + 20}")

    def fill() -> None:
        for commit in commits:
            store.commit(commit)

    with pytest.raises(StoreError, match=r"disk of the map store .* is full"):
        fill()
    (full,) = store.maps(YARD).maps
    assert 0 < full.vertices < 40
    assert check(from_topology(store.topology(YARD))) == []
    writer.execute("PRAGMA max_page_count = 1000000")
    fill()
    assert store.maps(YARD).maps[0].vertices == 40


def test_new_vertices_leave_the_reserve_so_that_a_map_can_still_be_finished_and_removed(tmp_path: Path) -> None:
    file = tmp_path / "maps.sqlite"
    commits = drive(0, 5, finished=False)
    before = Store(file)
    for commit in commits[:3]:
        before.commit(commit)
    before.close()
    store = Store(file, Settings(reserve_mb=1e12))
    with pytest.raises(StoreError, match="nearly full"):
        store.commit(commits[3])
    assert store.maps(YARD).maps[0].vertices == 3
    assert store.commit(commits[2]).text == "stored already"
    store.commit(Commit(finished=map_id(0)))
    store.name_place(NamePlace(environment="yard", place="barn", vertex=vertex_id(0, 1)))
    store.remove(GraphQuery(map=map_id(0)))
    assert store.maps(YARD).maps == []
    store.close()


def test_removing_a_map_makes_room_for_the_next(store: Store, tmp_path: Path) -> None:
    file = tmp_path / "store" / "maps.sqlite"
    sizes = []
    for number in range(4):
        for commit in drive(number, 20, size=LARGE):
            store.commit(commit)
        store.remove(GraphQuery(map=map_id(number)))
        store.checkpoint()
        sizes.append(file.stat().st_size)
    assert sizes[-1] <= sizes[0] * 1.1


def test_a_store_locked_by_another_process_refuses_and_then_goes_on(store: Store, tmp_path: Path) -> None:
    first, *rest = drive(0, 3)
    store.commit(first)
    other = sqlite3.connect(tmp_path / "store" / "maps.sqlite", isolation_level=None)
    other.execute("BEGIN IMMEDIATE")
    with pytest.raises(StoreError, match="locked by another process"):
        store.commit(rest[0])
    assert store.maps(YARD).maps[0].vertices == 1
    other.execute("ROLLBACK")
    other.close()
    for commit in rest:
        store.commit(commit)
    assert store.maps(YARD).maps[0].finished


def test_a_store_that_was_moved_away_takes_nothing_more(store: Store, tmp_path: Path) -> None:
    first, *rest = drive(0, 3)
    store.commit(first)
    (tmp_path / "store").rename(tmp_path / "elsewhere")
    with pytest.raises(StoreError):
        store.commit(rest[0])
    (tmp_path / "elsewhere").rename(tmp_path / "store")
    store.commit(rest[0])


def filled(file: Path, vertices: int = 20) -> Path:
    store = Store(file)
    for commit in drive(0, vertices, size=LARGE):
        store.commit(commit)
    store.name_place(NamePlace(environment="yard", place="barn", vertex=vertex_id(0, 1)))
    store.close()
    return file


def test_a_spoilt_keyframe_is_left_out_and_its_neighbours_are_not(tmp_path: Path) -> None:
    file = filled(tmp_path / "maps.sqlite", vertices=3)
    content = bytearray(file.read_bytes())
    place = content.find(keyframe(0, 1, LARGE).arrays["descriptors"][30_000:30_032].tobytes())
    assert place > 0, "a page ends within the bytes that were sought"
    content[place] ^= 0xFF
    file.write_bytes(content)
    store = Store(file)
    found = store.submap(GraphQuery(map=map_id(0))).vertices
    assert [v.id.index for v in found] == [0, 2]
    with pytest.raises(StoreError, match="damaged"):
        store.submap(GraphQuery(vertices=[vertex_id(0, 1)]))
    store.close()


@pytest.mark.parametrize("damage", ["garbage", "truncated", "zeroed"])
def test_a_damaged_file_is_refused_with_a_sentence(tmp_path: Path, damage: str) -> None:
    file = filled(tmp_path / "maps.sqlite")
    content = file.read_bytes()
    spoilt = {
        "garbage": b"this is no database" * 1000,
        "truncated": content[: 4 * 8192 + 100],
        "zeroed": content[:8192] + bytes(6 * 8192) + content[7 * 8192 :],
    }
    file.write_bytes(spoilt[damage])
    with pytest.raises(StoreError, match="damaged"):
        Store(file)
    assert file.read_bytes() == spoilt[damage]


def test_another_program_s_database_is_left_alone(tmp_path: Path) -> None:
    file = tmp_path / "maps.sqlite"
    other = sqlite3.connect(file)
    other.execute("CREATE TABLE maps (x)")
    other.close()
    before = file.read_bytes()
    with pytest.raises(StoreError, match="another program"):
        Store(file)
    assert file.read_bytes() == before


def test_a_newer_store_is_refused_and_left_alone(tmp_path: Path) -> None:
    file = filled(tmp_path / "maps.sqlite")
    db = sqlite3.connect(file)
    db.execute(f"PRAGMA user_version = {len(MIGRATIONS) + 1}")
    db.close()
    with pytest.raises(StoreError, match="update the program"):
        Store(file)


def test_an_older_store_is_brought_to_this_version_with_all_that_it_holds(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = filled(tmp_path / "maps.sqlite")
    newer = (*MIGRATIONS, ("ALTER TABLE maps ADD COLUMN weather TEXT NOT NULL DEFAULT 'sun'",))
    monkeypatch.setattr(database, "migrate", lambda db: migrate(db, newer))
    store = Store(file)
    assert store.maps(YARD).maps[0].vertices == 20
    assert store.topology(YARD).places == {"barn": vertex_id(0, 1)}
    for commit in drive(1, 3):
        store.commit(commit)
    store.close()
    db = sqlite3.connect(file)
    assert db.execute("PRAGMA user_version").fetchone() == (len(newer),)
    assert db.execute("SELECT DISTINCT weather FROM maps").fetchall() == [("sun",)]
    db.close()


def test_a_migration_that_fails_leaves_the_older_store_as_it_was(tmp_path: Path) -> None:
    file = filled(tmp_path / "maps.sqlite")
    broken = (*MIGRATIONS, ("ALTER TABLE maps ADD COLUMN weather TEXT", "ALTER TABLE nothing ADD COLUMN x"))
    db = sqlite3.connect(file, isolation_level=None)
    with pytest.raises(sqlite3.OperationalError):
        migrate(db, broken)
    db.close()
    store = Store(file)
    assert store.maps(YARD).maps[0].vertices == 20
    store.close()


def test_a_store_opened_twice_takes_commits_from_both(store: Store, tmp_path: Path) -> None:
    second = Store(tmp_path / "store" / "maps.sqlite")
    commits = drive(0, 10)
    for commit, writer in zip(commits, [store, second] * 6, strict=False):
        writer.commit(commit)
    assert store.maps(YARD).maps[0].vertices == second.maps(YARD).maps[0].vertices == 10
    second.close()


@pytest.mark.parametrize("folder", ["/proc/retraverse", "file/store"])
def test_a_folder_that_cannot_be_made_is_named(tmp_path: Path, folder: str) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(StoreError, match=str(Path(folder).name)):
        Store(tmp_path / folder / "maps.sqlite")


@pytest.mark.skipif(os.geteuid() == 0, reason="the superuser may write to a read-only folder")
def test_a_read_only_folder_is_named(tmp_path: Path) -> None:
    tmp_path.chmod(0o500)
    with pytest.raises(StoreError, match="cannot be"):
        Store(tmp_path / "maps.sqlite")
    tmp_path.chmod(0o700)


def test_after_closing_every_question_is_refused(store: Store) -> None:
    store.close()
    for ask in (lambda: store.maps(YARD), lambda: store.commit(drive(0, 1)[0])):
        with pytest.raises(RetraverseError, match="closing"):
            ask()


def test_a_refusal_does_not_hold_the_lock(store: Store) -> None:
    with pytest.raises(GraphError):
        store.commit(drive(0, 2)[1])
    assert store.commit(drive(0, 1)[0]).text == "committed"
