"""Ten thousand random and mutated samples on every topic end no process, move no robot and change no map."""

import numpy as np
import pytest
import zenoh

from common import topics
from common.topics import Delivery
from tests.fuzz import samples

COUNT = 10_000


@pytest.fixture(scope="module")
def calm_robot(robot):
    robot.calm()
    return robot


@pytest.mark.parametrize("topic", topics.ALL, ids=lambda topic: topic.key)
def test_bad_samples_do_nothing(calm_robot, topic):
    robot = calm_robot
    before = robot.pids(), robot.vertices(), robot.standing()
    key = topic.at(robot.bus.robot, "front")
    send = _ask if topic.delivery is Delivery.QUERY else _put
    for sample in samples(topic, robot.bus.robot, COUNT, seed=hash_of(topic)):
        send(robot.bus.session, key, sample)
    odometry = robot.bus.subscribe(topics.ODOMETRY)
    assert odometry.wait(10.0) is not None
    pids, vertices, place = before
    assert robot.pids() == pids
    assert robot.vertices() == vertices
    assert np.allclose(robot.standing(), place, atol=1e-6)
    states = robot.states()
    robot.soon(lambda: states.last() is not None, "the navigator says its state")
    assert states.last().message.name == "Idle"


def hash_of(topic):
    """A seed of the topic that is the same in every run."""
    return sum(topic.key.encode())


def _put(session, key, sample):
    session.put(key, sample.payload, attachment=sample.attachment, congestion_control=zenoh.CongestionControl.BLOCK)


def _ask(session, key, sample):
    for _ in session.get(key, payload=sample.payload, attachment=sample.attachment, timeout=2.0):
        pass
