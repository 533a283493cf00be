"""What ``vtr maps`` shows of taught maps and of those recorded in repeats."""

import json

import numpy as np
import pytest

from common import topics
from common.ids import new_map_id
from common.messages import MapList, MapRecord, MapSummary, Topology
from tests.processes import Robot

TAUGHT = MapRecord(id=new_map_id("r1", 0), environment="park", stamp=0, robot="r1", sensor="stereo")
RECORDED = MapRecord(
    id=new_map_id("r1", 10**9), environment="park", stamp=10**9, robot="r1", sensor="stereo", generation=1,
    parent=TAUGHT.id,
)  # fmt: skip


@pytest.fixture
def robot(tmp_path):
    """A robot whose store has a taught map and one that was recorded on the way of its repeat."""
    maps = [
        MapSummary(record=record, vertices=10, length=5.0, bytes=10**6, finished=True) for record in (TAUGHT, RECORDED)
    ]
    graph = Topology(
        environment="park", maps=maps, edges=np.array([[1, 0, 0, 0], [1, 4, 0, 4]], np.int32),
        spatial=np.ones(2, np.uint8), T_a_b=np.tile(np.eye(4), (2, 1, 1)), covariances=np.zeros((2, 6, 6)), places={},
    )  # fmt: skip
    with Robot(tmp_path) as robot:
        store = robot.act_as("mapstore")
        store.serve(topics.MAPS, lambda _: MapList(maps=maps))
        store.serve(topics.TOPOLOGY, lambda _: graph)
        yield robot


def test_the_list_tells_generations_and_parents(robot, vtr):
    listed = vtr("maps", "ls", "-c", robot.config).out.splitlines()
    rows = {line.split()[0]: line for line in listed if line.split()}
    assert TAUGHT.id in rows[RECORDED.id]
    assert rows[TAUGHT.id].count(TAUGHT.id) == 1
    data = json.loads(vtr("maps", "ls", "--json", "-c", robot.config).out)["maps"]
    assert [(m["generation"], m["parent"]) for m in data] == [(0, None), (1, TAUGHT.id)]


def test_a_recorded_map_shows_what_it_is_joined_to(robot, vtr):
    shown = json.loads(vtr("maps", "show", RECORDED.id, "--json", "-c", robot.config).out)
    assert (shown["generation"], shown["parent"], shown["joined_to"]) == (1, TAUGHT.id, {TAUGHT.id: 2})
