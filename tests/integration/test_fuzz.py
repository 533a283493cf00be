"""Thousands of random and mutated samples on every topic end no process, move no robot and change no map."""

from collections import deque

import numpy as np
import pytest
import zenoh

from common import topics
from common.topics import Delivery
from tests.fuzz import samples

UNDER_WAY = 48


@pytest.fixture
def calm_robot(robot):
    robot.calm()
    return robot


@pytest.mark.parametrize("count", [1_000, pytest.param(10_000, marks=pytest.mark.long)])
@pytest.mark.parametrize("topic", topics.ALL, ids=lambda topic: topic.key)
def test_bad_samples_do_nothing(calm_robot, topic, count):
    robot = calm_robot
    before = robot.pids(), robot.vertices(), robot.standing()
    key = topic.at(robot.bus.robot, "front")
    send = _ask_all if topic.delivery is Delivery.QUERY else _put_all
    send(robot.bus.session, key, samples(topic, robot.bus.robot, count, seed=hash_of(topic)))
    odometry = robot.hear(topics.ODOMETRY)
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


def _put_all(session, key, spoilt):
    for sample in spoilt:
        session.put(key, sample.payload, attachment=sample.attachment, congestion_control=zenoh.CongestionControl.BLOCK)


def _ask_all(session, key, spoilt):
    """Asks, with a few dozen questions under way at a time."""
    under_way = deque()
    for sample in spoilt:
        under_way.append(session.get(key, payload=sample.payload, attachment=sample.attachment, timeout=5.0))
        if len(under_way) >= UNDER_WAY:
            list(under_way.popleft())
    for replies in under_way:
        list(replies)
