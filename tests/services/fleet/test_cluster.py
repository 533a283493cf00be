"""A Dask cluster of real processes: a worker that is killed in the middle of a row changes nothing in the result."""

from __future__ import annotations

import os
import signal
import threading

import distributed
import numpy as np
import pytest

from services.fleet import analysis
from services.fleet.cluster import Cluster, Stopped
from services.fleet.groups import Along
from services.fleet.rows import Images, row
from tests.processes import eventually
from tests.services.fleet.running import running
from tests.services.fleet.shared import FolderStorage, map_id, metadata, share

HOURS = [5.3 * k for k in range(12)]


class Slow(FolderStorage):
    """A storage of which a worker reads slowly, and tells that it does."""

    def read(self, key):
        if "/images/" in key and distributed_worker():
            (self.folder / f"reading-{os.getpid()}").touch()
            threading.Event().wait(0.3)
        return super().read(key)

    def readers(self):
        return [int(path.name.removeprefix("reading-")) for path in self.folder.glob("reading-*")]


def distributed_worker():
    try:
        return distributed.get_worker() is not None
    except ValueError:
        return False


@pytest.fixture
def cluster(tmp_path):
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None, local_directory=str(tmp_path / "d")
    ) as made:
        yield made


def test_a_worker_killed_in_the_middle_of_a_row_changes_nothing(cluster, tmp_path, monkeypatch):
    monkeypatch.setattr(analysis, "BLOCK", 3)
    storage = Slow(tmp_path / "storage")
    for hours in HOURS:
        share(storage, metadata(hours))
    with running(storage, scratch=tmp_path / "t") as server:
        expected = server.settled(len(HOURS)).similarities().values
    share(storage, metadata(99.0))
    with running(storage, scheduler=cluster.scheduler_address, scratch=tmp_path / "t") as server:
        victim = eventually(storage.readers, "a worker reads images", 60.0)[0]
        os.kill(victim, signal.SIGKILL)
        found = server.settled(len(HOURS) + 1).similarities()
        assert len(set(storage.readers())) >= 2
    assert found.maps[-1] == map_id(99.0)
    assert found.values[:-1, :-1].tolist() == expected.tolist()
    images = [Along.of(metadata(hours)) for hours in (*HOURS, 99.0)]
    alone = [row(images[-1].values, Images.of(one.values), one.cell_height)[0] for one in images]
    assert found.values[-1].tolist() == pytest.approx(alone, abs=1e-6)


def test_a_scheduler_that_is_gone_is_waited_for(tmp_path):
    stop = threading.Event()
    threading.Timer(0.5, stop.set).start()
    with pytest.raises(Stopped):
        Cluster("tcp://127.0.0.1:9", 1, tmp_path, stop).map(np.sum, [([1, 2],)])


def test_what_a_function_raises_is_raised(tmp_path):
    threads = Cluster("", 1, tmp_path, threading.Event())
    with pytest.raises(ZeroDivisionError):
        threads.map(divmod, [(4, 2), (1, 0)])
    assert threads.map(divmod, [(4, 2), (1, 1)]) == [(2, 0), (1, 0)]
    threads.close()
