"""A process that is killed while it writes or reads an archive leaves nothing half, and the next one goes on."""

from __future__ import annotations

import signal
import subprocess
import sys
import threading
from pathlib import Path

import numpy as np
import pytest

from common.messages import Commit, GraphQuery, MapEnds
from common.posegraph import check, from_topology
from services.mapstore.archive import import_archive, write_archive
from services.mapstore.archive.writing import checked_sum
from services.mapstore.errors import StoreError
from services.mapstore.settings import Settings
from services.mapstore.store import Store
from tests.services.mapstore.archive.conftest import SETTINGS
from tests.services.mapstore.graphs import drive, map_id, spatial, temporal, vertex, vertex_id

YARD = GraphQuery(environment="yard")
VERTICES, LARGE = 30, 200_000

WORK = """
import sys
from pathlib import Path
from services.mapstore.archive import import_archive, write_archive
from services.mapstore.store import Store
from services.mapstore.archive import importing
importing._AT_A_TIME = 1
store = Store(Path(sys.argv[2]))
print("open", flush=True)
tell = lambda done: print(done, flush=True)
if sys.argv[1] == "read":
    import_archive(store, Path(sys.argv[3]), None, advance=tell)
else:
    real = store.whole_vertex
    store.whole_vertex = lambda vertex: (tell(vertex.index), real(vertex))[1]
    write_archive(store, sys.argv[4], Path(sys.argv[3]))
print("whole", flush=True)
"""


def killed(job: str, store: Path, file: Path, lines: int, wait_ms: float) -> bool:
    """Starts a process, kills it some time after it has said some lines, and tells whether it had come to its end."""
    command = [sys.executable, "-c", WORK, job, str(store), str(file), map_id(0)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        said = [process.stdout.readline() for _ in range(lines)]
        threading.Event().wait(wait_ms / 1e3)
        process.send_signal(signal.SIGKILL)
        said += process.stdout.readlines()
    return "whole\n" in said


@pytest.fixture
def large(store: Store) -> Store:
    """A map of 6 MB and a repeat that is joined to it at every vertex."""
    for commit in [*drive(0, VERTICES, size=LARGE), *drive(1, VERTICES, generation=1)]:
        store.commit(commit)
    for index in range(VERTICES):
        store.commit(Commit(edges=[spatial(vertex_id(0, index), vertex_id(1, index))]))
    for number in (0, 1):
        store.ends(MapEnds(map=map_id(number)))
    return store


def test_a_reader_that_is_killed_leaves_nothing_to_be_seen_and_the_next_completes_it(
    large: Store, tmp_path: Path
) -> None:
    file, repeat = tmp_path / "a.zip", tmp_path / "b.zip"
    archive = write_archive(large, map_id(0), file)
    target = tmp_path / "target" / "maps.sqlite"
    first = Store(target, SETTINGS)
    import_archive(first, repeat, write_archive(large, map_id(1), repeat))
    first.close()
    rng = np.random.default_rng(3)
    for lines in (1, 9, 20, VERTICES, VERTICES + 1):
        whole = killed("read", target, file, lines, rng.uniform(0, 5))
        store = Store(target, SETTINGS)
        seen = [m for m in store.maps(YARD).maps if m.record.id == map_id(0)]
        assert seen == [] if not seen else seen[0].vertices == VERTICES
        assert bool(seen) >= whole
        store.commit(drive(lines + 100, 1)[0])
        store.close()
    store = Store(target, SETTINGS)
    import_archive(store, file, archive)
    assert check(from_topology(store.topology(YARD))) == []
    again = tmp_path / "again.zip"
    for number, original in ((0, file), (1, repeat)):
        assert write_archive(store, map_id(number), again) == checked_sum(original)
    store.close()


def test_a_writer_that_is_killed_leaves_no_archive_or_a_whole_one(large: Store, tmp_path: Path) -> None:
    source = tmp_path / "store" / "maps.sqlite"
    whole = write_archive(large, map_id(0), tmp_path / "whole.zip")
    file = tmp_path / "a.zip"
    rng = np.random.default_rng(4)
    for lines in (2, 15, VERTICES + 1):
        killed("write", source, file, lines, rng.uniform(0, 30))
        assert not file.exists() or checked_sum(file) == whole
    assert write_archive(large, map_id(0), file) == whole
    assert sorted(path.name for path in tmp_path.glob("a.zip*")) == ["a.zip"]


def test_a_robot_that_drives_commits_while_archives_come_and_go(large: Store, tmp_path: Path) -> None:
    file = tmp_path / "a.zip"
    archive = write_archive(large, map_id(0), file)
    failures: list[BaseException] = []
    store = Store(tmp_path / "robot" / "maps.sqlite", Settings(checkpoint_mb=0.3, reserve_mb=0))
    done = threading.Event()

    def come_and_go() -> None:
        try:
            for _ in range(3):
                import_archive(store, file, archive)
                assert write_archive(store, map_id(0), tmp_path / "again.zip") == archive
                store.remove(GraphQuery(map=map_id(0)))
        except BaseException as error:  # noqa: BLE001, handed to the test's own thread
            failures.append(error)
        finally:
            done.set()

    thread = threading.Thread(target=come_and_go)
    store.commit(drive(7, 1)[0])
    thread.start()
    count = 1
    while not done.is_set():
        store.commit(Commit(vertex=vertex(7, count), edges=[temporal(7, count)]))
        count += 1
    thread.join()
    assert failures == []
    (own,) = store.maps(YARD).maps
    assert own.vertices == count > 3
    store.close()


def test_a_full_disk_stops_the_reader_with_a_sentence_and_it_goes_on_later(large: Store, tmp_path: Path) -> None:
    file = tmp_path / "a.zip"
    archive = write_archive(large, map_id(0), file)
    small = Store(tmp_path / "small" / "maps.sqlite", SETTINGS)
    writer = small._database._writer
    writer.execute("PRAGMA max_page_count = 300")
    with pytest.raises(StoreError, match="is full"):
        import_archive(small, file, archive)
    assert small.maps(YARD).maps == []
    writer.execute("PRAGMA max_page_count = 1000000")
    assert import_archive(small, file, archive).vertices == VERTICES
    small.close()
    reserved = Store(tmp_path / "reserved" / "maps.sqlite", Settings(reserve_mb=1e12))
    with pytest.raises(StoreError, match="nearly full"):
        import_archive(reserved, file, archive)
    reserved.close()
