"""Two robots and their fleet's server, through real storage: one drives over a map that only the other has taught."""

import json
import subprocess
import sys
from datetime import UTC, datetime

import numpy as np
import pytest

from cli.daylight import Times
from cli.demo.configuration import LEARNER, TEACHER, config_file, write_config
from cli.demo.driver import DriverSettings
from cli.demo.errors import path_errors
from cli.demo.fleet import DemoFleet
from cli.demo.story import Offset, Story
from common.topics import FLEET

pytestmark = pytest.mark.long

NOON = datetime(2026, 6, 21, 11, tzinfo=UTC)
PACE = DriverSettings(speed=1.1, acceleration=1.0)
FIRST_M, SECOND_M = 13.0, 11.0
GAP_M = 0.8
SHARED_S = 60.0


def test_a_robot_drives_over_anothers_map_and_on_over_its_own(tmp_path):
    with DemoFleet(tmp_path, (TEACHER, LEARNER), quiet) as fleet:
        for name in (TEACHER, LEARNER):
            config = config_file(tmp_path, name)
            write_config(config, tmp_path / "data", Times(NOON, NOON), name=name, link=fleet.link(name))
        with Story(config_file(tmp_path, TEACHER), quiet) as teacher:
            route = teacher.route()
            first, taught_first = teacher.teach(metres(route, 0.0, FIRST_M), PACE, ("start", "gate"))
            teacher.await_shared(first, SHARED_S)
        with Story(config_file(tmp_path, LEARNER), quiet) as learner:
            begin = FIRST_M + GAP_M
            second_route = metres(route, begin, begin + SECOND_M)
            learner.put_down(*second_route[0])
            second, taught_second = learner.teach(second_route, PACE, ("gate", "end"))
            learner.await_shared(second, SHARED_S)
            start = taught_first.poses()[0]
            repeated = learner.repeat(start, Offset(), FIRST_M + SECOND_M, 150.0, "start")
            assert repeated.final_reason.startswith("reached"), repeated.final_reason
            maps = {found.record.id: found for found in learner.maps()}
            pulled = vtr("maps", "pull", first, "--config", config_file(tmp_path, LEARNER))
            learner.await_shared(next(m.record.id for m in learner.maps() if m.record.parent == second), SHARED_S)
        catalog = {entry.map: (entry.start, entry.end) for entry in fleet.catalog()}
        exported = tmp_path / "garden.json"
        vtr("env", "export", "--config", config_file(tmp_path, FLEET), "-o", exported)
        plan = vtr("env", "plan", "--from", "start", "--to", "end", "--config", config_file(tmp_path, FLEET))
        same = vtr("env", "plan", "--from", "start", "--to", "end", "--env", exported)
        shared = vtr("maps", "ls", "--fleet", "--config", config_file(tmp_path, FLEET))
        processes = vtr("fleet", "ps", config_file(tmp_path, FLEET))
    assert pulled["maps"][0]["sync"] == "Fetched"
    assert plan["maps"] == same["maps"]
    assert {one["name"] for one in shared["maps"]} == set(catalog)
    assert {row["name"]: row["state"] for row in processes["processes"]} == {
        "router": "RUNNING",
        "storage": "RUNNING",
        "fleet": "RUNNING",
        "console": "RUNNING",
    }
    recorded = {ends for name, ends in catalog.items() if name not in {first, second}}
    assert recorded == {("start", "gate"), ("gate", "end")}, "each stretch was recorded as a map of its own"
    assert maps[first].sync == "Fetched"
    assert catalog[first] == ("start", "gate")
    assert catalog[second] == ("gate", "end")
    taught = np.concatenate([taught_first.poses(), taught_second.poses()])
    settled = np.abs(path_errors(taught, repeated.poses()).after(5.0).lateral)
    assert np.sqrt(np.mean(settled**2)) <= 0.05
    assert settled.max() <= 0.20
    assert np.linalg.norm(repeated.poses()[-1][:3, 3] - taught[-1][:3, 3]) <= 0.15
    assert slowest_at(repeated, taught_first.poses()[-1]) > 0.5, "it does not stop where the maps meet"


def vtr(*arguments):
    """What a command prints as JSON."""
    command = [sys.executable, "-m", "cli", *map(str, arguments), "--json"]
    return json.loads(subprocess.run(command, check=True, capture_output=True, text=True, timeout=60).stdout)


def quiet(_text, _part):
    """Progress that nobody watches."""


def metres(route, begin, end):
    """The part of a route (N, 3) between two arc lengths."""
    arclength = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(route[:, :2], axis=0), axis=1))])
    return route[(arclength >= begin) & (arclength <= end)]


def slowest_at(recording, pose, radius=1.5):
    """The least speed within ``radius`` metres of a pose."""
    return min(abs(t.v) for t in recording.truth if np.linalg.norm(t.T_world_vehicle[:2, 3] - pose[:2, 3]) < radius)
