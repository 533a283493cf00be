"""A tap hears every sample in order, and counts what did not come and what no receiver would take."""

from __future__ import annotations

import pytest

from common import topics, wire
from common.bus import Tap
from common.bus.envelope import Envelope, Source
from common.messages import VelocityCommand

SAFETY = Source("r1", "safety", "a1")
KEY = "vtr/r1/command/safe"


class Bytes(bytes):
    def to_bytes(self):
        return bytes(self)


class Raw:
    """What Zenoh hands to a callback."""

    def __init__(self, number, source=SAFETY, *, attached=True):
        self.key_expr = KEY
        self.payload = Bytes(wire.encode(VelocityCommand(stamp=1, v=number, w=0.0)))
        envelope = Envelope.seal(self.payload, source, number, 1)
        self.attachment = Bytes(envelope.pack()) if attached else None


@pytest.fixture
def tap():
    return Tap("r1")


def hear(tap, *raws):
    receive = tap.receiver(topics.SAFE)
    for raw in raws:
        receive(raw)
    taken = iter(tap.take, None)
    return [sample.envelope.sequence for sample in taken]


def test_samples_come_in_order_each_once(tap):
    assert hear(tap, *map(Raw, (4, 5, 5, 6, 4))) == [4, 5, 6]
    assert not +tap.lost
    assert tap.take() is None


def test_a_gap_is_counted_and_another_life_begins_anew(tap):
    other = Source("r1", "safety", "b2")
    assert hear(tap, Raw(1), Raw(4), Raw(1, other), Raw(2, other)) == [1, 4, 1, 2]
    assert +tap.lost == {"command/safe": 2}


def test_what_no_receiver_would_take_is_refused(tap):
    damaged = Raw(3)
    damaged.payload = Bytes(damaged.payload[:-1] + b"\xff")
    strangers = [
        Raw(1, attached=False),
        damaged,
        Raw(1, Source("r2", "safety", "a")),
        Raw(1, Source("r1", "tracker", "a")),
    ]
    assert hear(tap, *strangers) == []
    assert tap.refused == {"command/safe": 4}


def test_samples_that_find_no_room_are_counted_once_another_comes():
    size = len(Raw(1).payload)
    tap = Tap("r1", most_bytes=2 * size)
    assert hear(tap, Raw(1), Raw(2), Raw(3), Raw(4)) == [1, 2]
    assert hear(tap, Raw(5)) == [5]
    assert +tap.lost == {"command/safe": 2}


def test_a_key_is_found_with_its_name():
    assert topics.find("sensor/stereo/front") == (topics.STEREO, "front")
    assert topics.find("state") == (topics.STATE, "")
    for key in ("graph/maps", "sensor/stereo/", "sensor/stereo/a/b", "nothing", ""):
        assert topics.find(key) is None
