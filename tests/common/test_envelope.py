from __future__ import annotations

import random

import msgpack
import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.bus.envelope import Envelope, Source
from common.errors import MalformedMessage
from common.topics import SCHEMA

SOURCE = Source.of("r1", "tracker")
whole = st.integers(0, 2**63 - 1)


@given(st.binary(max_size=200), whole, whole)
def test_an_envelope_is_opened_as_it_was_sealed(payload, sequence, stamp):
    envelope = Envelope.seal(payload, SOURCE, sequence, stamp)
    assert Envelope.open(envelope.pack(), payload) == envelope


def test_two_lives_of_a_process_are_two_sources():
    assert Source.of("r1", "tracker") != Source.of("r1", "tracker")


@given(st.binary(min_size=1, max_size=200), st.data())
def test_a_changed_payload_is_refused(payload, data):
    attachment = Envelope.seal(payload, SOURCE, 1, 1).pack()
    index, flip = data.draw(st.integers(0, len(payload) - 1)), data.draw(st.integers(1, 255))
    changed = bytearray(payload)
    changed[index] ^= flip
    with pytest.raises(MalformedMessage, match="checksum"):
        Envelope.open(attachment, bytes(changed))


def test_a_missing_envelope_and_another_schema_are_refused():
    with pytest.raises(MalformedMessage, match="no envelope"):
        Envelope.open(None, b"")
    other = Envelope.seal(b"", SOURCE, 1, 1)._replace(schema=SCHEMA + 1)
    with pytest.raises(MalformedMessage, match=f"schema {SCHEMA + 1}"):
        Envelope.open(other.pack(), b"")


@pytest.mark.parametrize(
    "fields",
    [
        [], 3, None, "text", [1, 2, 3, 4, 5, 6], [SCHEMA, 1, 1, ["a", "b"], 0],
        [SCHEMA, 1, 1, ["a", "b", 3], 0], [SCHEMA, -1, 1, list(SOURCE), 0], [SCHEMA, 1.0, 1, list(SOURCE), 0],
        [SCHEMA, float("inf"), 1, list(SOURCE), 0], [SCHEMA, True, 1, list(SOURCE), 0],
        [SCHEMA, "1", 1, list(SOURCE), 0],
    ],
)  # fmt: skip
def test_fields_of_other_types_are_refused(fields):
    with pytest.raises(MalformedMessage, match="cannot be read"):
        Envelope.open(msgpack.packb(fields), b"")


def test_mutated_envelopes_are_refused_or_read_and_nothing_else():
    rng = random.Random(3)  # noqa: S311, reproducible, not secret
    attachment = Envelope.seal(b"payload", SOURCE, 7, 8).pack()
    for _ in range(5000):
        changed = bytearray(attachment)
        for _ in range(rng.randint(1, 4)):
            changed[rng.randrange(len(changed))] = rng.randrange(256)
        try:
            Envelope.open(bytes(changed[: rng.randint(0, 2 * len(changed))]), b"payload")
        except MalformedMessage:
            continue
