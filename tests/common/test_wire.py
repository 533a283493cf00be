from __future__ import annotations

import random

import msgpack
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays_of

from common import wire
from common.arrays import DTYPES
from common.errors import MalformedMessage
from common.messages import Keyframe, Message, StereoFrame, VelocityCommand
from tests import fuzz

EXAMPLES = {type(message): message for message in (*fuzz.valid_examples().values(), *fuzz.valid_answers().values())}
every_message = pytest.mark.parametrize("model", EXAMPLES, ids=lambda model: model.__name__)

numbers = {name: st.floats(allow_nan=False, allow_infinity=False, width=8 * int(name[-1])) for name in ("<f4", "<f8")}
keyframe_arrays = st.sampled_from(sorted(DTYPES)).flatmap(
    lambda name: arrays_of.arrays(
        name, arrays_of.array_shapes(min_dims=0, max_dims=4, min_side=0), elements=numbers.get(name)
    )
)


def assert_equal(one: object, other: object) -> None:
    if isinstance(one, Message):
        assert type(one) is type(other)
        for name in type(one).model_fields:
            assert_equal(getattr(one, name), getattr(other, name))
    elif isinstance(one, dict):
        assert one.keys() == other.keys()
        for key in one:
            assert_equal(one[key], other[key])
    elif isinstance(one, list):
        assert len(one) == len(other)
        for a, b in zip(one, other, strict=True):
            assert_equal(a, b)
    elif isinstance(one, np.ndarray):
        assert (one.dtype, one.shape) == (other.dtype, other.shape)
        np.testing.assert_array_equal(one, other)
    else:
        assert one == other


@every_message
def test_every_message_arrives_as_it_was_sent(model):
    message = EXAMPLES[model]
    assert_equal(message, wire.decode(model, wire.encode(message)))


@given(st.dictionaries(st.text(max_size=20), keyframe_arrays, max_size=5), st.binary(max_size=100))
def test_arrays_of_every_type_and_shape_arrive(arrays, thumbnail):
    keyframe = Keyframe(pipeline="p", arrays=arrays, thumbnail=thumbnail)
    assert_equal(keyframe, wire.decode(Keyframe, wire.encode(keyframe)))


@given(st.floats(allow_nan=False, allow_infinity=False), st.integers(0, 2**63 - 1))
def test_numbers_arrive_exactly(number, stamp):
    command = VelocityCommand(stamp=stamp, v=number, w=-number)
    assert wire.decode(VelocityCommand, wire.encode(command)) == command


def test_arrays_that_are_not_contiguous_arrive():
    array = np.arange(60.0).reshape(3, 4, 5)
    keyframe = Keyframe(pipeline="p", arrays={"a": array[::-1, ::2].T, "b": np.asfortranarray(array)})
    assert_equal(keyframe, wire.decode(Keyframe, wire.encode(keyframe)))


def test_arrays_are_read_only_views_as_aligned_as_their_message():
    example = EXAMPLES[StereoFrame]
    data = bytes(wire.encode(example))
    frame = wire.decode(StereoFrame, data)
    start = np.frombuffer(data, np.uint8).__array_interface__["data"][0]
    for image in (frame.left, frame.right, frame.camera.T_vehicle_camera):
        offset = image.__array_interface__["data"][0] - start
        assert 0 < offset <= len(data) - image.nbytes
        assert offset % 64 == 0
        assert not image.flags.writeable


@every_message
def test_a_truncated_message_is_malformed(model):
    data = wire.encode(EXAMPLES[model])
    cuts = range(0, len(data), 1 + len(data) // 400)
    end = 8 + int.from_bytes(data[4:8], "little")
    for cut in cuts:
        try:
            wire.decode(model, data[:cut])
        except MalformedMessage:
            continue
        assert cut >= end, "only padding may be missing"


@every_message
def test_mutated_and_hostile_bytes_are_malformed_or_a_message_and_nothing_else(model):
    rng = random.Random(model.__name__)  # noqa: S311, reproducible, not secret
    data = wire.encode(EXAMPLES[model])
    for _ in range(1500):
        for hostile in (fuzz.mutated(data, rng), fuzz.hostile_header(rng), rng.randbytes(rng.randrange(100))):
            try:
                wire.decode(model, hostile)
            except MalformedMessage as error:
                assert "\n" not in str(error)  # noqa: PT017, one sentence for the log


@every_message
def test_bytes_behind_the_end_change_nothing(model):
    message = EXAMPLES[model]
    assert_equal(message, wire.decode(model, bytes(wire.encode(message)) + bytes(1000)))


def _with_array(dtype: object, shape: object, offset: object, body: int = 64) -> bytes:
    extension = msgpack.ExtType(1, msgpack.packb([dtype, shape, offset]))
    header = msgpack.packb({"pipeline": "p", "arrays": {"a": extension}})
    return b"VTR1" + len(header).to_bytes(4, "little") + header + bytes(-(8 + len(header)) % 64 + body)


def test_the_hostile_arrays_differ_from_a_right_one_in_one_thing():
    assert wire.decode(Keyframe, _with_array("<f8", [8], 0)).arrays["a"].shape == (8,)


@pytest.mark.parametrize(
    ("dtype", "shape", "offset"),
    [
        ("<f8", [9], 0), ("<f8", [8], 64), ("<f8", [1], 8), ("|u1", [2**63, 2], 0), ("|u1", [2**62, 0, 2**62], 0),
        ("|u1", [2**64 - 1, 0], 0), ("|u1", [0], 2**64 - 1), ("|u1", [-1], 0), ("|u1", [1], -64), ("|u1", [True], 0),
        ("|u1", [1.0], 0), ("|u1", [1] * 6, 0), ("|u1", 5, 0), ("|O", [1], 0), ("<M8[ns]", [1], 0), (["|u1"], [1], 0),
        (None, [1], 0), ("|u1", [1], None),
    ],
)  # fmt: skip
def test_an_array_that_is_none_or_reaches_outside_is_malformed(dtype, shape, offset):
    with pytest.raises(MalformedMessage):
        wire.decode(Keyframe, _with_array(dtype, shape, offset))


@pytest.mark.parametrize("size", [9, 1000, 2**31, 2**32 - 1])
def test_a_header_longer_than_the_message_is_malformed(size):
    with pytest.raises(MalformedMessage, match="header"):
        wire.decode(VelocityCommand, b"VTR1" + size.to_bytes(4, "little") + b"\x80")


def test_another_message_or_an_unknown_field_is_malformed():
    with pytest.raises(MalformedMessage, match="VelocityCommand"):
        wire.decode(VelocityCommand, wire.encode(EXAMPLES[StereoFrame]))


def test_what_is_no_number_is_not_sent():
    with pytest.raises(ValueError, match="finite"):
        VelocityCommand(stamp=1, v=float("nan"), w=0.0)
