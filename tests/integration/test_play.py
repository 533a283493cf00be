"""A real recording played through the running processes: the map in the store is the drive that was recorded."""

import numpy as np
import pytest

from cli import client, player
from cli.robot import load
from cli.supervision.supervised import Supervised
from common import topics
from common.geometry import inverse
from common.ids import VertexId
from common.messages import Command, GraphQuery, StateName
from common.posegraph.topology import from_topology
from services.sensors.recordings import open_recording
from services.sensors.recordings.timeline import StereoTimeline
from tests.integration.whole_robot import state_is
from tests.processes import eventually, free_port

END_POINT = 0.013
"""Largest distance from the true end, as a part of the path's length."""


@pytest.fixture(params=["none", "synthetic"])
def robot(tmp_path, request):
    """A robot without sensors of its own, or one whose synthetic world has to fall silent for the player."""
    path = tmp_path / "robot.toml"
    path.write_text(
        f'[robot]\nname = "playback"\ndirectory = "data"\n[bus]\nendpoint = "tcp/127.0.0.1:{free_port()}"\n'
        f'[sensors]\ndriver = "{request.param}"\n',
        encoding="utf-8",
    )
    with Supervised(path):
        yield load(path)


@pytest.fixture
def recording(data_dir):
    return open_recording(data_dir / "kitti06_gray_stereo")


def _stored_path(bus, record):
    """Poses (N, 4, 4) of a map's vertices in the frame of the first one, and the environment's places."""
    topology = bus.ask(topics.TOPOLOGY, GraphQuery(environment=record.environment), timeout=10.0)
    graph = from_topology(topology)
    vertices = [VertexId(record.id, index) for index in range(graph.experiences[record.id].vertices)]
    return graph.poses_along(vertices), {place: vertex.index for place, vertex in topology.places.items()}


def test_a_played_recording_is_a_map_with_the_recorded_path(recording, robot):
    with client.connect(robot, player.PROCESS) as bus:
        states = bus.subscribe(topics.STATE)
        command = Command(action="teach", start_place="start", end_place="end")
        playing = player.Player(bus, StereoTimeline(recording, "front"))
        played = playing.teach(command, "sensor/stereo/front", lambda: None)
        (stored,) = bus.ask(topics.MAPS, GraphQuery(), timeout=10.0).maps
        path, places = _stored_path(bus, stored.record)
        eventually(lambda: state_is(states, StateName.IDLE), "the robot is idle")
    assert stored.finished
    assert stored.record.id == played.map
    # The drive moves by more than a vertex's distance from each frame to the next.
    assert stored.vertices == len(recording)
    assert places == {"start": 0, "end": stored.vertices - 1}
    truth = recording.poses_truth @ inverse(recording.camera.T_vehicle_camera)
    truth = inverse(truth[0]) @ truth
    length = np.linalg.norm(np.diff(truth[:, :3, 3], axis=0), axis=1).sum()
    assert abs(stored.length - length) < 0.01 * length
    assert np.linalg.norm(path[:, :3, 3] - truth[:, :3, 3], axis=1).max() < END_POINT * length
