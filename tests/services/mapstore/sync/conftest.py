"""A storage for all tests of this folder, and robots that share through it."""

from __future__ import annotations

import threading

import pytest

from common.errors import NoAnswer
from common.messages import MapEnds
from services.mapstore.settings import Settings
from services.mapstore.store import Store
from services.mapstore.sync.engine import Syncer
from services.mapstore.sync.settings import SyncSettings
from tests.processes import eventually
from tests.storage import Storage


@pytest.fixture(scope="package")
def storage(tmp_path_factory):
    with Storage(tmp_path_factory.mktemp("server")) as storage:
        yield storage


class Robot:
    """A map store with its syncer's threads."""

    def __init__(self, folder, storage, name="r1", **fields):
        self.store = Store(folder / "maps.sqlite", Settings(reserve_mb=0))
        self.folder = folder / "sync"
        self.stop = threading.Event()
        self.told = []
        settings = storage.settings(name, SyncSettings, **{"retry_s": 0.5} | fields)
        self.syncer = Syncer(lambda: self.store, settings, name, self.folder, folder, self._tell, self.stop)
        self._threads = [threading.Thread(target=one) for one in (self.syncer.upload, self.syncer.fetch)]

    def start(self):
        for thread in self._threads:
            thread.start()
        return self

    def close(self):
        self.stop.set()
        for thread in self._threads:
            if thread.ident is not None:
                thread.join()
        self.store.close()

    def teach(self, commits, start="gate", end="yard"):
        for commit in commits:
            self.store.commit(commit)
        map_id = commits[0].map.id
        self.store.ends(MapEnds(map=map_id, start_place=start, end_place=end))
        self.syncer.notice()
        return map_id

    def soon(self, condition, what, deadline=20.0):
        try:
            return eventually(condition, what, deadline)
        except AssertionError as error:
            raise AssertionError(f"{error}\n{self.syncer.status()}") from None

    def _tell(self, announcement):
        self.told.append(announcement)
        raise NoAnswer("there is no server")


@pytest.fixture
def robots(tmp_path, storage):
    made = []

    def make(name="r1", **fields):
        robot = Robot(tmp_path / name, fields.pop("storage", storage), name, **fields)
        made.append(robot)
        return robot

    yield make
    for robot in made:
        robot.close()
