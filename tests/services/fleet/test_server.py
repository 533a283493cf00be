"""The fleet's server over a real router and a real storage: what robots put there is learnt, whatever is killed."""

from __future__ import annotations

import itertools
import json
import os
import socket
import subprocess
import sys

import numpy as np
import pytest

from cli.__main__ import run
from common import topics
from common.bus import Bus
from common.environment.metadata import Archive, ImageAlong, MapMetadata, archive_key, metadata_key, report_key, time_of
from common.errors import BusError, Refused
from common.ids import new_map_id
from common.messages import (
    Announcement,
    CatalogQuery,
    FleetPlanRequest,
    FleetQuery,
    MapReport,
    RepeatReport,
    SimilarityQuery,
)
from common.objects.embedded import SERVER
from common.registration import OF_THUMBNAILS, GradientRepresentation
from tests.processes import eventually
from tests.storage import Storage

HOUR = 3_600_000_000_000
NOON = 1_782_000_000 * 10**9 // HOUR * HOUR
ENVIRONMENTS = itertools.count()


@pytest.fixture(scope="module")
def storage(tmp_path_factory):
    with Storage(tmp_path_factory.mktemp("server")) as storage:
        yield storage


class Fleet:
    """The server's process and its router."""

    def __init__(self, folder, storage):
        with socket.socket() as probe:
            probe.bind(("127.0.0.1", 0))
            self.endpoint = f"tcp/127.0.0.1:{probe.getsockname()[1]}"
        self.config = folder / "fleet.toml"
        credentials = storage.settings(SERVER).credentials
        self.config.write_text(
            f'[server]\ndirectory = "{folder}"\n[bus]\nendpoint = "{self.endpoint}"\n'
            f'[fleet]\nendpoint = "{storage.endpoint}"\ncredentials = "{credentials}"\nreconcile_s = 0.5\n'
        )
        self.router = start("services.router", self.config)
        self.start()
        self.bus = Bus("r1", "operator", self.endpoint, timeout=20)

    def start(self):
        self.server = start("services.fleet", self.config)

    def kill(self):
        self.server.kill()
        self.server.wait()

    def close(self):
        self.bus.close()
        for process in (self.server, self.router):
            process.terminate()
            process.wait()

    def ask(self, topic, question, name=""):
        return self.bus.ask(topic, question, timeout=3.0, name=name)

    def soon(self, condition, what, deadline=30.0):
        def tried():
            try:
                return condition()
            except BusError:
                return False

        return eventually(tried, what, deadline)

    def names(self, environment):
        return [
            entry.map for entry in self.ask(topics.CATALOG, CatalogQuery(environment=environment), environment).entries
        ]

    def similarities(self, environment, maps):
        """Once so many maps are known, and all of them compared."""

        def compared():
            names = self.ask(topics.ENVIRONMENTS, FleetQuery())
            return names.maps.get(environment) == maps and not names.pending[environment]

        self.soon(compared, "all are compared")
        return self.ask(topics.SIMILARITY, SimilarityQuery(environment=environment), environment)

    def plan(self, environment, start, goal, **fields):
        request = {"stamp": NOON, "sensor": "stereo", "theta": (1.0, 0.0, 0.0)} | fields
        request = FleetPlanRequest(environment=environment, start=start, goal=goal, **request)
        return self.ask(topics.FLEET_PLAN, request, environment)


def start(module, config):
    return subprocess.Popen([sys.executable, "-m", module], env=os.environ | {"VTR_CONFIG": str(config)})


@pytest.fixture(scope="module")
def fleet(tmp_path_factory, storage):
    fleet = Fleet(tmp_path_factory.mktemp("fleet"), storage)
    yield fleet
    fleet.close()


@pytest.fixture
def environment():
    return f"park-{next(ENVIRONMENTS)}"


def put_map(storage, environment, start, end, stamp=NOON, *, scene=0, robot="r1", **fields):
    """Puts a map into the storage as a robot does; returns its id."""
    map_id = new_map_id(robot, stamp)
    content = {
        "name": map_id, "environment": environment, "robot": robot, "sensor": "stereo", "timestamp": time_of(stamp),
        "length": 10.0, "start": start, "end": end, "vertices": 1, "times": [0.0], "distances": [0.0],
        "images": [picture(scene)], "archive": Archive(bytes=3, sha256="0" * 64),
    }  # fmt: skip
    metadata = MapMetadata(**(content | fields))
    objects = storage.connect(robot)
    objects.put("maps", archive_key(environment, map_id), b"zip")
    assert objects.create("environments", metadata_key(environment, map_id), metadata.model_dump_json().encode())
    return map_id


def picture(scene):
    noise = np.random.default_rng(scene).integers(0, 256, (32, 50), dtype=np.uint8).repeat(4, 0).repeat(4, 1)
    return ImageAlong.of(0.0, GradientRepresentation(OF_THUMBNAILS).describe(noise))


def announce(fleet, environment, map_id):
    fleet.ask(topics.ANNOUNCE, Announcement(environment=environment, robot="r1", map=map_id), environment)


def test_an_announced_map_is_planned_over_and_compared(fleet, storage, environment):
    a = put_map(storage, environment, "gate", "yard")
    fleet.soon(lambda: announce(fleet, environment, a) or True, "the server hears")
    b = put_map(storage, environment, "yard", "shed", NOON + HOUR, robot="r2")
    announce(fleet, environment, b)
    fleet.soon(lambda: len(fleet.names(environment)) == 2, "both are known")
    found = fleet.plan(environment, "gate", "shed")
    assert [entry.map for entry in found.entries] == [a, b]
    assert "it is also the shortest" in found.why[-1]
    put_map(storage, environment, "gate", "yard", NOON + 2 * HOUR)
    matrix = fleet.similarities(environment, 3)
    assert matrix.maps[0] == a
    assert matrix.values == pytest.approx(np.ones((2, 2)), abs=0.02), "b leads elsewhere: it is not compared with a"
    fleet.soon(lambda: "not enough data" in fleet.plan(environment, "gate", "shed").model.reason, "a model is made")


def test_what_nobody_announces_is_found(fleet, storage, environment):
    a = put_map(storage, environment, "gate", "yard")
    fleet.soon(lambda: fleet.names(environment) == [a], "the map is found")
    assert fleet.ask(topics.ENVIRONMENTS, FleetQuery()).maps[environment] == 1


def test_what_is_no_metadata_is_left_out(fleet, storage, environment):
    server = storage.connect()
    stranger = new_map_id("r1", NOON)
    server.put("environments", f"robots/r1/{environment}/maps/{stranger}.json", b"{}")
    server.put("environments", f"robots/r1/{environment}/maps/x.json", b"\x80pickle")
    thief = put_map(storage, environment, "gate", "yard", name=new_map_id("r2", NOON))
    a = put_map(storage, environment, "gate", "yard", NOON + 1000)
    fleet.soon(lambda: fleet.names(environment) == [a], "the sound one is known")
    assert thief not in fleet.names(environment)


def test_plans_are_for_a_robots_own_sensor_and_without_what_it_cannot_use(fleet, storage, environment):
    a = put_map(storage, environment, "gate", "yard", sensor="lidar")
    b = put_map(storage, environment, "gate", "yard", NOON + 1000)
    c = put_map(storage, environment, "gate", "yard", NOON + 2000)
    fleet.soon(lambda: set(fleet.names(environment)) == {a, b, c}, "all are known")
    assert fleet.plan(environment, "gate", "yard", sensor="lidar").entries[0].map == a
    assert fleet.plan(environment, "gate", "yard", without=[b]).entries[0].map == c
    with pytest.raises(Refused, match="no sequence of maps"):
        fleet.plan(environment, "gate", "yard", without=[b, c])
    with pytest.raises(Refused, match="did you mean gate"):
        fleet.plan(environment, "gat", "yard")


def test_trouble_of_repeats_raises_a_maps_cost_at_that_hour(fleet, storage, environment):
    a = put_map(storage, environment, "gate", "yard")
    b = put_map(storage, environment, "gate", "yard", NOON + 1000)
    fleet.soon(lambda: len(fleet.names(environment)) == 2, "both are known")
    chosen = fleet.plan(environment, "gate", "yard").entries[0].map
    report = RepeatReport(
        id="20261126-x", robot="r2", environment=environment, stamp=NOON, maps=[
            MapReport(map=chosen, metres=100.0, lost=80.0)
        ],
    )  # fmt: skip
    key = report_key("r2", environment, report.id)
    storage.connect("r2").create("environments", key, report.model_dump_json().encode())
    other = ({a, b} - {chosen}).pop()
    fleet.soon(lambda: fleet.plan(environment, "gate", "yard").entries[0].map == other, "the other is chosen")
    (told,) = fleet.plan(environment, "gate", "yard").alternatives
    assert told.trouble[NOON // HOUR % 24] == pytest.approx(80 / 120, abs=0.01)
    assert told.trouble[(NOON // HOUR + 12) % 24] < 0.01


def test_a_killed_server_goes_on_where_it_was(fleet, storage, environment):
    ids = [put_map(storage, environment, "gate", "yard", NOON + k * HOUR, scene=k % 2) for k in range(5)]
    fleet.soon(lambda: fleet.names(environment) == ids, "all are known")
    before = fleet.similarities(environment, len(ids))
    revision = fleet.plan(environment, "gate", "yard").model.revision
    fleet.kill()
    later = put_map(storage, environment, "gate", "yard", NOON + 9 * HOUR)
    fleet.start()
    fleet.soon(lambda: fleet.names(environment) == [*ids, later], "all are known again")
    after = fleet.similarities(environment, len(ids) + 1)
    assert after.values[:5, :5].tolist() == before.values.tolist()
    fleet.soon(lambda: fleet.plan(environment, "gate", "yard").model.revision > revision, "the model goes on")
    fleet.ask(topics.REBUILD, FleetQuery())
    fleet.soon(lambda: fleet.names(environment) == [*ids, later], "all are known once more")
    rebuilt = fleet.similarities(environment, len(ids) + 1)
    order = [rebuilt.maps.index(name) for name in after.maps]
    assert rebuilt.values[np.ix_(order, order)] == pytest.approx(after.values)


@pytest.mark.long
def test_a_server_killed_again_and_again_while_it_compares_ends_with_the_same(fleet, storage, environment):
    count = 24
    for k in range(count):
        put_map(storage, environment, "gate", "yard", NOON + 7 * k * HOUR, scene=k % 5)
    for left in (20, 12, 4):

        def few_pending(left=left):
            names = fleet.ask(topics.ENVIRONMENTS, FleetQuery())
            return names.maps.get(environment) == count and names.pending[environment] <= left

        fleet.soon(few_pending, "some are compared")
        fleet.kill()
        fleet.start()
    before = fleet.similarities(environment, count)
    fleet.ask(topics.REBUILD, FleetQuery())
    after = fleet.similarities(environment, count)
    assert after.maps == before.maps
    assert after.values == pytest.approx(before.values, abs=1e-6)


def test_the_commands_show_what_the_running_fleet_knows(fleet, storage, environment, capsys):
    ids = [put_map(storage, environment, "gate", "yard", NOON + k * HOUR, scene=k % 3) for k in range(4)]
    matrix = fleet.similarities(environment, len(ids))

    def vtr(*arguments):
        capsys.readouterr()
        options = ("--environment", environment, "--config", str(fleet.config), "--json")
        assert run(["env", *arguments, *options]) == 0
        return json.loads(capsys.readouterr().out)

    assert vtr("similarity")["matrix"] == np.round(matrix.values, 6).tolist()
    assert "not enough data" in vtr("spectrum")["reason"]
    assert "not enough data" in vtr("model")["reason"]
    assert [one["name"] for one in vtr("export")["maps"]] == ids
    assert [one["name"] for one in vtr("cost")["maps"]] == ids
    assert vtr("plan", "--from", "gate", "--to", "yard")["maps"][0] in ids
