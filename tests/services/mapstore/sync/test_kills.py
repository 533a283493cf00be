"""``kill -9`` of either of two robots that share with each other, or of the storage, at any moment.

``VTR_KILL_RUNS=200 pytest tests/services/mapstore/sync/test_kills.py`` makes as many runs; by default a few.
"""

from __future__ import annotations

import json
import os
import random
import subprocess
import sys
import time
from collections import Counter

import pytest

from common import wire
from common.environment.metadata import MapMetadata, archive_key, metadata_key
from common.ids import VertexId
from common.messages import Commit, GraphQuery, MapEnds, SyncState
from services.mapstore.archive import verify
from services.mapstore.settings import Settings
from services.mapstore.store import Store
from tests.processes import eventually
from tests.services.mapstore.graphs import drive
from tests.storage import Storage

RUNS = int(os.environ.get("VTR_KILL_RUNS", "3"))
NUMBERS = {"r1": 1, "r2": 2}
PART_BYTES = 5 * 1024 * 1024
LONGEST_S = 1.2


@pytest.fixture(scope="module")
def storage(tmp_path_factory):
    with Storage(tmp_path_factory.mktemp("server")) as storage:
        yield storage


class Robot:
    """A robot with one map to share and another's to fetch, and the process that does it."""

    def __init__(self, folder, name, run, storage):
        self.folder = folder / name
        self.folder.mkdir()
        self.name = name
        self.number = 1000 * run + NUMBERS[name]
        self._told = self.folder / "told.json"
        commits = of_robot(drive(self.number, 8, size=1_400_000), name)
        self.map_id = commits[0].map.id
        with_store(self, lambda store: [store.commit(commit) for commit in commits])
        with_store(self, lambda store: store.ends(MapEnds(map=self.map_id, start_place="gate", end_place="yard")))
        self._credentials = storage.settings(name).credentials
        self._endpoint = storage.endpoint
        self._child = None

    def start(self, other):
        self._told.write_text(
            json.dumps(
                {
                    "folder": str(self.folder),
                    "robot": self.name,
                    "endpoint": self._endpoint,
                    "credentials": str(self._credentials),
                    "fetch": [other.map_id],
                }
            )
        )
        self._child = subprocess.Popen(
            [sys.executable, "-m", "tests.services.mapstore.sync.worker", str(self._told)],
            stderr=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
        )

    def kill(self):
        self._child.kill()
        self._child.wait()

    def is_done(self, other):
        stored = {m.record.id: m.sync for m in with_store(self, lambda store: store.maps(GraphQuery())).maps}
        return stored.get(self.map_id) is SyncState.SYNCED and stored.get(other.map_id) is SyncState.FETCHED

    def sent(self):
        return Counter((self.folder / "sent").read_text().splitlines())


def with_store(robot, use):
    store = Store(robot.folder / "maps.sqlite", Settings(reserve_mb=0, lock_timeout_s=5.0))
    try:
        return use(store)
    finally:
        store.close()


@pytest.mark.timeout(60)
@pytest.mark.parametrize("run", range(RUNS))
def test_nothing_is_lost_torn_or_doubled(tmp_path, storage, run):
    chance = random.Random(run)  # noqa: S311, chance for tests
    one, other = (Robot(tmp_path, name, run, storage) for name in ("r1", "r2"))
    one.start(other)
    other.start(one)
    try:
        time.sleep(chance.uniform(0.0, LONGEST_S))
        victim = (one, other, storage)[run % 3]
        victim.kill()
        if victim is storage:
            storage.start()
        else:
            victim.start(other if victim is one else one)
        for robot, peer in ((one, other), (other, one)):
            eventually(lambda robot=robot, peer=peer: robot.is_done(peer), "both are shared and fetched", 40)
    finally:
        one.kill()
        other.kill()
    for robot, peer in ((one, other), (other, one)):
        check_storage(storage, robot, tmp_path)
        assert contents(robot, robot.map_id) == contents(peer, robot.map_id)
        assert sum(robot.sent().values()) - len(robot.sent()) <= 1, "at most one part is sent again"
        assert not [file for file in (robot.folder / "sync").glob("*") if robot.map_id in file.name]


def of_robot(commits, name):
    """The commits of a drive, as another robot made it."""
    old = commits[0].map.id
    new = old.replace("-r1-", f"-{name}-")

    def renamed(commit):
        data = {}
        if commit.map is not None:
            data["map"] = commit.map.model_copy(update={"id": new, "robot": name})
        if commit.vertex is not None:
            data["vertex"] = commit.vertex.model_copy(update={"id": VertexId(new, commit.vertex.id.index)})
        data["edges"] = [
            edge.model_copy(update={"a": VertexId(new, edge.a.index), "b": VertexId(new, edge.b.index)})
            for edge in commit.edges
        ]
        return Commit(finished=None if commit.finished is None else new, **data)

    return [renamed(commit) for commit in commits]


def contents(robot, map_id):
    """All of a map as a robot has it."""

    def read(store):
        count = store.summary(map_id).vertices
        return [wire.encode(store.whole_vertex(VertexId(map_id, k))) for k in range(count)], [
            wire.encode(edge) for edge in store.edges_of(map_id)
        ]

    return with_store(robot, read)


def check_storage(storage, robot, folder):
    """The storage has one sound archive of a robot's map, and its metadata."""
    server = storage.connect()
    metadata = MapMetadata.model_validate_json(server.get("environments", metadata_key("yard", robot.map_id)))
    file = folder / f"{robot.name}.zip"
    server.download("maps", archive_key("yard", robot.map_id), file)
    verify(file, metadata.archive, robot.map_id)
    assert metadata.archive.bytes > 2 * PART_BYTES
