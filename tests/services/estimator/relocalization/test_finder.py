"""The estimator's answer to ``relocalize``, against a map store that the test plays."""

from __future__ import annotations

import threading

import numpy as np
import pytest

from common import topics, wire
from common.errors import NoAnswer, Refused
from common.geometry import Uncertain
from common.ids import VertexId
from common.messages import Appearances, Keyframe, Relocalize, Submap, VertexRecord
from common.posegraph import to_topology
from services.estimator.pipeline import Step
from services.estimator.relocalization import Finder, PlaceUnknown, RelocalizationSettings
from tests.services.estimator.relocalization.network import Network, record, vertex


class Store:
    """A map store that holds a network, and gives it in pages of a few vertices."""

    def __init__(self, network, page=7):
        self.network = network
        self.page = page
        self.away = False
        self.refuses = False
        self.asked = []

    def ask(self, topic, question, timeout):
        assert 0 < timeout < 10
        if self.away:
            raise NoAnswer("nobody answers")
        self.asked.append(topic)
        answers = {topics.APPEARANCE: self.appearances, topics.TOPOLOGY: self.topology, topics.SUBMAP: self.submap}
        return wire.decode(topic.answer, wire.encode(answers[topic](question)))

    def appearances(self, question):
        experiences = self.network.graph.experiences if question.environment == "yard" else {}
        ids = list(experiences)
        new = [
            (k, index)
            for k, map_id in enumerate(ids)
            for index in range(question.known.get(map_id, 0), experiences[map_id].vertices)
        ]
        looks = [self.network.looks[VertexId(ids[k], index)] for k, index in new[: self.page]]
        return Appearances(
            maps=[experiences[map_id].record for map_id in ids],
            vertices=np.array(new[: self.page], np.int32).reshape(-1, 2),
            counts={"plain": np.array([len(found) for found in looks], np.int32)},
            descriptors={"plain": np.concatenate([np.zeros((0, 32), np.uint8), *looks])},
            more=len(new) > self.page,
        )

    def topology(self, question):
        assert question.environment == "yard"
        return to_topology(self.network.graph)

    def submap(self, question):
        if self.refuses:
            raise Refused("the store has no map")
        empty = Keyframe(pipeline="stereo", arrays={})
        return Submap(vertices=[VertexRecord(id=v, stamp=0, keyframe=empty) for v in question.vertices])


PATIENT_S = 600.0
"""The only frame of a test does not grow stale on a slow machine."""


class Robot:
    """A robot in a network, with a pipeline that knows the truth."""

    def __init__(self, network, max_age_s=PATIENT_S, **settings):
        self.network = network
        self.store = Store(network)
        self.at = vertex(1, 20)
        self.bad = set()
        self.finder = Finder(
            self.store.ask,
            lambda live: {"plain": live[2]},
            "yard",
            max_age_s,
            RelocalizationSettings(period_s=0.01, **settings),
        )
        self.finder.searcher = self

    def find(self, environment="yard"):
        self.see(idle=True)
        return self.finder.answer(Relocalize(environment=environment))

    def see(self, *, idle):
        live = (self.network.poses[self.at], {}, self.network.looks[self.at])
        motion = Uncertain.identity()
        step = Step(
            stamp=77, T_last_live=motion, keyframe=0, T_keyframe_live=motion, twist=np.zeros(6), success=True,
            inliers=100, reason="", live=live,
        )  # fmt: skip
        self.finder.see(step, idle=idle)

    def read(self, stored):
        if stored.id in self.bad:
            raise ValueError("not whole")
        return stored.id

    def search(self, submap, live):
        return self.network.search(submap, live[:2])


@pytest.fixture
def robot():
    network = Network()
    network.add_map(0, 30)
    network.add_map(1, 30, origin=(0.0, 100.0))
    return Robot(network)


def test_a_robot_that_was_switched_on_anywhere_finds_itself(robot):
    for at in (vertex(1, 20), vertex(0, 3), vertex(0, 29)):
        robot.at = at
        answer = robot.find()
        assert answer.vertex == at
        assert (answer.stamp, answer.inliers, answer.stream) == (77, 100, "plain")
        np.testing.assert_allclose(answer.T_vertex_robot, np.eye(4), atol=1e-9)


def test_only_what_is_new_is_read_again(robot):
    robot.find()
    pages = robot.store.asked.count(topics.APPEARANCE)
    assert pages == 9
    robot.network.add_map(2, 5, origin=(50.0, 0.0))
    robot.at = vertex(2, 4)
    assert robot.find().vertex == vertex(2, 4)
    assert robot.store.asked.count(topics.APPEARANCE) == pages + 1


def test_a_removed_map_is_forgotten(robot):
    robot.find()
    looks = robot.network.looks
    robot.network.graph = Network().graph
    robot.network.add_map(0, 30)
    robot.network.looks.update({name: found for name, found in looks.items() if name.map_id == vertex(1, 0).map_id})
    with pytest.raises(PlaceUnknown, match="nothing in environment 'yard' looks like"):
        robot.find()


def test_each_refusal_has_its_sentence(robot):
    with pytest.raises(PlaceUnknown, match="environment 'moon' has no vertex that could be recognised"):
        robot.find("moon")
    with pytest.raises(PlaceUnknown, match="no frame of the sensor"):
        Robot(robot.network).finder.answer(Relocalize(environment="yard"))
    with pytest.raises(PlaceUnknown, match="no frame of the sensor"):
        Robot(robot.network, max_age_s=-1.0).find()
    robot.see(idle=True)
    robot.finder.searcher = None
    with pytest.raises(PlaceUnknown, match="no frame of the sensor"):
        robot.find()
    robot.finder.searcher = robot
    robot.store.refuses = True
    with pytest.raises(PlaceUnknown, match="the map store refuses"):
        robot.find()
    robot.store.refuses, robot.store.away = False, True
    with pytest.raises(NoAnswer):
        robot.find()
    robot.store.away = False
    assert robot.find().vertex == robot.at


def test_a_keyframe_that_cannot_be_read_keeps_no_other_away(robot):
    robot.bad = {vertex(1, 19), vertex(0, 3)}
    assert robot.find().vertex == robot.at


def test_beyond_the_bound_the_oldest_recorded_maps_are_left_out_and_stay_out():
    network = Network()
    network.add_map(0, 20)
    for number in (1, 2, 3):
        network.add_map(number, 20, origin=(0.0, 100.0 * number), generation=1)
    robot = Robot(network, max_vertices=50)
    for _ in range(2):
        for number, is_known in enumerate([True, False, False, True]):
            robot.at = vertex(number, 10)
            if is_known:
                assert robot.find().vertex == robot.at
            else:
                with pytest.raises(PlaceUnknown, match="looks like"):
                    robot.find()
    network.graph.add_vertex(vertex(1, 20))
    network.looks[vertex(1, 20)] = network.looks[vertex(1, 19)]
    robot.at = vertex(0, 2)
    robot.find()
    assert len(robot.finder._network.index) == 40


def test_vertices_are_taken_in_while_the_robot_is_idle_and_not_while_it_drives(robot):
    stop, pause = threading.Event(), threading.Event()
    robot.see(idle=False)
    robot.store.away = True
    worker = threading.Thread(target=lambda: robot.finder.run(stop))
    worker.start()
    try:
        pause.wait(0.1)
        assert robot.store.asked == []
        robot.see(idle=True)
        pause.wait(0.05)
        robot.store.away = False
        for _ in range(500):
            if len(robot.finder._network.index) == 60:
                break
            pause.wait(0.01)
        assert len(robot.finder._network.index) == 60
    finally:
        stop.set()
        worker.join(5)
    assert not worker.is_alive()


def test_a_map_without_temporal_edges_in_the_graph_is_no_obstacle(robot):
    robot.network.graph.add_experience(record(9))
    assert robot.find().vertex == robot.at
