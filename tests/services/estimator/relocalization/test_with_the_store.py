"""The whole way: frames become vertices of a map store, and a robot that knows nothing finds itself in it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from common import geometry, topics, wire
from common.ids import VertexId, new_map_id
from common.messages import Commit, EdgeRecord, MapRecord, Relocalize, VertexRecord
from services.estimator.relocalization import Finder, PlaceUnknown, appearance_of
from services.estimator.stereo import StereoSettings
from services.estimator.stereo.pipeline import StereoPipeline
from services.mapstore.store import Store
from tests.services.estimator.stereo.scene import CAMERA, render

STEP = 0.4
MAP = new_map_id("r1", 10**9)
QUESTION = Relocalize(environment="yard")


def at(z, x=0.0):
    """``T_world_vehicle`` of a camera of the rendered scene; its mounting turns axes only."""
    mounting = CAMERA.T_vehicle_camera
    return mounting @ geometry.exp([x, 0.0, z, 0.0, 0.02, 0.0]) @ geometry.inverse(mounting)


def seen(z, x=0.0, seed=0):
    """A processed frame from a place, by a pipeline that has seen nothing else."""
    mounting = CAMERA.T_vehicle_camera
    left, right = render(geometry.inverse(mounting) @ at(z, x) @ mounting, seed=seed)
    return StereoPipeline(CAMERA, StereoSettings()).process(left, right, 1000 + seed)


def looks_of(live):
    return appearance_of({name: frame.features for name, frame in live.items()})


@pytest.fixture(scope="module")
def store(tmp_path_factory):
    """A store with one taught map of four vertices."""
    store = Store(tmp_path_factory.mktemp("store") / "maps.sqlite")
    record = MapRecord(id=MAP, environment="yard", stamp=0, robot="r1", sensor="front")
    pipeline = StereoPipeline(CAMERA, StereoSettings())
    for index in range(4):
        live = seen(STEP * index, seed=index).live
        keyframe = pipeline.keyframe(live).model_copy(update={"appearance": looks_of(live)})
        edges = []
        if index:
            T = geometry.inverse(at(STEP * (index - 1))) @ at(STEP * index)
            a, b = VertexId(MAP, index - 1), VertexId(MAP, index)
            edges = [EdgeRecord(kind="temporal", a=a, b=b, T_a_b=T, covariance=1e-6 * np.eye(6))]
        vertex = VertexRecord(id=VertexId(MAP, index), stamp=index, keyframe=keyframe)
        store.commit(Commit(map=record, vertex=vertex, edges=edges))
    yield store
    store.close()


@pytest.fixture
def finder(store):
    answers = {topics.APPEARANCE: store.appearances, topics.TOPOLOGY: store.topology, topics.SUBMAP: store.submap}

    def ask(topic, question, _timeout):
        return wire.decode(topic.answer, wire.encode(answers[topic](question)))

    finder = Finder(ask, looks_of, "yard", 0.5)
    finder.searcher = StereoPipeline(CAMERA, StereoSettings())
    return finder


@pytest.fixture(autouse=True)
def _patient(monkeypatch):
    """The only frame of a test does not grow stale on a slow machine."""
    monkeypatch.setattr(topics, "STEREO", replace(topics.STEREO, max_age_s=600.0))


def test_a_robot_finds_itself_by_what_the_store_holds(finder):
    finder.see(seen(0.9, x=0.1, seed=50), idle=True)
    answer = finder.answer(QUESTION)
    assert answer.vertex == VertexId(MAP, 2)
    assert (answer.stamp, answer.stream) == (1050, "plain")
    expected = geometry.inverse(at(2 * STEP)) @ at(0.9, x=0.1)
    np.testing.assert_allclose(answer.T_vertex_robot, expected, atol=0.03)
    assert np.linalg.eigvalsh(answer.covariance).min() > 0


def test_a_robot_in_another_environment_does_not(finder):
    finder.see(seen(0.9, seed=51), idle=True)
    with pytest.raises(PlaceUnknown, match="environment 'field' has no vertex"):
        finder.answer(Relocalize(environment="field"))
