"""The server over a storage: what is committed is noticed, compared once, kept, and can all be made again."""

from __future__ import annotations

import numpy as np
import pytest
import structlog

from common import messages as m
from common.errors import GraphError, RetraverseError, Unavailable
from tests.processes import eventually
from tests.services.fleet.running import running
from tests.services.fleet.shared import ENVIRONMENT, FolderStorage, garbage, map_id, metadata, report, share

HOURS = [5.3 * k for k in range(16)]


class Counting(FolderStorage):
    """A storage that remembers what is written, and can be away."""

    def __init__(self, folder):
        super().__init__(folder)
        self.written: list[str] = []
        self.away = False

    def read(self, key):
        self._check()
        return super().read(key)

    def keys(self, prefix):
        self._check()
        return super().keys(prefix)

    def write(self, key, content):
        self._check()
        self.written.append(key)
        super().write(key, content)

    def rows(self):
        return [key for key in self.written if "/rows/" in key]

    def _check(self):
        if self.away:
            raise RetraverseError("the storage is away")


@pytest.fixture
def storage(tmp_path):
    made = Counting(tmp_path / "storage")
    for hours in HOURS:
        share(made, metadata(hours))
    return made


@pytest.fixture
def start(storage, tmp_path):
    return lambda **settings: running(storage, scratch=tmp_path / "dask", **settings)


def test_maps_are_compared_a_row_each_and_a_restart_computes_none_again(storage, start):
    with start() as server:
        first = server.settled(len(HOURS)).similarities()
        model = server.published[-1]
    assert first.maps == sorted(map_id(hours) for hours in HOURS)
    assert first.values == pytest.approx(first.values.T)
    assert len(storage.rows()) == len(HOURS)
    storage.written.clear()
    with start() as server:
        again = server.settled(len(HOURS)).similarities()
        assert server.published == [model]
        told = server.environments.state(ENVIRONMENT).spectrum_told()
    assert again.values.tolist() == first.values.tolist()
    assert storage.written == []
    assert told.revision == model.revision
    assert told.power.max() > dict(told.levels)[0.1]


def test_a_new_map_is_one_new_row_and_a_new_model(storage, start):
    with start() as server:
        server.settled(len(HOURS))
        revision = server.published[-1].revision
        storage.written.clear()
        share(storage, metadata(200.0))
        server.environments.announce(m.Announcement(environment=ENVIRONMENT, robot="r1", map=map_id(200.0)))
        values = server.settled(len(HOURS) + 1).similarities().values
        assert len(storage.rows()) == 1
        assert server.published[-1].revision == revision + 1
        assert server.published[-1].maps == len(HOURS) + 1
        assert values.shape == (17, 17)


def test_a_burst_is_one_model(storage, start):
    with start(model_every_s=3600.0) as server:
        server.settled(len(HOURS))
        for k in range(10):
            share(storage, metadata(200.0 + k))
            told = m.Announcement(environment=ENVIRONMENT, robot="r1", map=map_id(200.0 + k))
            server.environments.announce(told)
        server.settled(len(HOURS) + 10)
        assert len(server.published) <= 4


def test_what_was_not_announced_is_found_by_listing(storage, start):
    with start(reconcile_s=0.2) as server:
        server.settled(len(HOURS))
        share(storage, metadata(200.0))
        report(storage, map_id(200.0), 9.0, 50.0)
        server.settled(len(HOURS) + 1)
        eventually(lambda: server.catalog()[-1].trouble, "the report is counted")


def test_repeats_that_went_well_are_counted_and_a_restart_counts_them(storage, start):
    report(storage, map_id(HOURS[0]), 9.0, 0.0)
    for _ in range(2):
        with start() as server:
            server.settled(len(HOURS))
            announced = m.Announcement(environment=ENVIRONMENT, robot="r2", report="b")
            report(storage, map_id(HOURS[1]), 9.0, 0.0, name="b")
            server.environments.announce(announced)
            state = server.environments.state(ENVIRONMENT)
            eventually(lambda state=state: len(state.feedback.counted) == 2, "both reports are counted")
            assert not any(entry.trouble for entry in server.catalog())


def test_bad_objects_are_named_once_and_stop_nothing(storage, start):
    bad = garbage(storage)
    with structlog.testing.capture_logs() as logs, start(reconcile_s=0.1) as server:
        server.settled(len(HOURS))
        share(storage, metadata(200.0))
        server.settled(len(HOURS) + 1)
    told = [line["key"] for line in logs if line["event"] == "an object is left alone"]
    assert sorted(told) == sorted(set(told))
    assert set(told) <= set(bad)
    assert len(told) == 4


def test_an_archive_that_comes_late_is_no_reason_to_forget_the_map(storage, start):
    late = metadata(200.0)
    storage.write(f"robots/r1/{ENVIRONMENT}/maps/{late.name}.json", late.model_dump_json().encode())
    with start(reconcile_s=0.1) as server:
        server.settled(len(HOURS))
        share(storage, late)
        server.settled(len(HOURS) + 1)


def test_rebuilding_gives_the_same(storage, start):
    with start() as server:
        report(storage, map_id(HOURS[0]), 9.0, 50.0)
        server.environments.announce(m.Announcement(environment=ENVIRONMENT, robot="r2", report="a"))
        before = server.settled(len(HOURS)).similarities().values
        eventually(lambda: server.catalog()[0].trouble, "the report is counted")
        model, catalog = server.published[-1], server.catalog()
        server.published.clear()
        server.environments.rebuild()
        after = server.settled(len(HOURS)).similarities().values
        assert after == pytest.approx(before, abs=1e-6)
        assert server.catalog() == catalog
        again = server.published[-1]
        assert again.revision > model.revision
        assert again.periods_hours == pytest.approx(model.periods_hours)
        assert again.weights == pytest.approx(model.weights, abs=1e-4)
        assert all(one.maps == len(HOURS) for one in server.published), "nobody is told of a model of nothing"


@pytest.mark.parametrize("harm", ["remove", "tear"])
def test_derived_objects_that_are_lost_or_torn_are_made_again(storage, start, harm):
    with start() as server:
        before = server.settled(len(HOURS)).similarities().values
    for number, key in enumerate(list(storage.keys("derived/"))):
        if number % 3 == 0:
            if harm == "remove":
                storage.remove(key)
            else:
                storage.write(key, storage.read(key)[:-9])
    with start() as server:
        assert server.settled(len(HOURS)).similarities().values == pytest.approx(before, abs=1e-6)
        assert all(one.maps == len(HOURS) for one in server.published)


def test_a_storage_that_is_away_is_waited_for(storage, start):
    storage.away = True
    with start() as server:
        with pytest.raises(Unavailable):
            server.environments.names()
        storage.away = False
        server.settled(len(HOURS))
        storage.away = True
        assert server.plan().entries
        share(FolderStorage(storage.folder), metadata(200.0))
        server.environments.announce(m.Announcement(environment=ENVIRONMENT, robot="r1", map=map_id(200.0)))
        storage.away = False
        server.settled(len(HOURS) + 1)


def test_maps_between_other_places_are_not_compared_with_these(storage, start):
    for hours in HOURS[:5]:
        share(storage, metadata(hours + 0.5, "gate", "barn"))
    share(storage, metadata(300.0, None, None))
    share(storage, metadata(301.0, "gate", "barn", images=[]))
    with start() as server:
        server.settled(len(HOURS) + 6)
        assert len(server.similarities().maps) == len(HOURS)
        assert len(server.similarities(start="gate", end="barn").maps) == 5
        assert server.published[-1].maps == len(HOURS) + 5
        with pytest.raises(GraphError, match="have been compared"):
            server.similarities(start="barn")
        assert server.plan(goal="barn").entries[-1].start == "gate"


def test_only_the_newest_of_a_route_are_compared(storage, start):
    with start(compared=6) as server:
        found = server.settled(len(HOURS)).similarities()
        assert found.maps == sorted(map_id(hours) for hours in HOURS)[-6:]
        assert np.isfinite(found.values).all()
        share(storage, metadata(-50.0))
        share(storage, metadata(500.0))
        for hours in (-50.0, 500.0):
            told = m.Announcement(environment=ENVIRONMENT, robot="r1", map=map_id(hours))
            server.environments.announce(told)
        found = server.settled(len(HOURS) + 2).similarities()
        assert found.maps[-1] == map_id(500.0)
        assert len(found.maps) == 6


def test_a_map_that_is_removed_leaves_the_catalog_and_the_matrix(storage, start):
    gone = map_id(HOURS[3])
    with start(reconcile_s=0.1) as server:
        server.settled(len(HOURS))
        storage.remove(f"robots/r1/{ENVIRONMENT}/maps/{gone}.json")
        server.settled(len(HOURS) - 1)
        assert gone not in server.similarities().maps
        assert gone not in [entry.map for entry in server.catalog()]


def test_reports_raise_a_map_s_cost_at_their_time_of_day(storage, start):
    with start() as server:
        chosen = server.settled(len(HOURS)).plan(hour=24 * 30 + 9).entries[0].map
        for k in range(3):
            report(storage, chosen, 9.0, 90.0, name=f"r{k}")
            told = m.Announcement(environment=ENVIRONMENT, robot="r2", report=f"r{k}")
            server.environments.announce(told)
            server.environments.announce(told)
        eventually(lambda: server.plan(hour=24 * 30 + 9).entries[0].map != chosen, "another map is chosen")
        trouble = next(entry.trouble for entry in server.catalog() if entry.map == chosen)
        eventually(lambda: trouble[9] > 0.7 and trouble[21] < 0.1, "it is about nine in the morning")


def test_an_unknown_environment_or_sensor_is_said(start):
    with start() as server:
        server.settled(len(HOURS))
        with pytest.raises(GraphError, match=f"knows {ENVIRONMENT}"):
            server.environments.state("moon")
        with pytest.raises(GraphError, match="lidar"):
            server.plan(sensor="lidar")
