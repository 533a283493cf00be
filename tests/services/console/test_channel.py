"""A reader of a channel has, after all it was told, what the channel shows."""

import json

from hypothesis import given, settings
from hypothesis import strategies as st

from services.console.channel import Channel

KEYS = st.sampled_from(["a", "b", "c"])
DOINGS = st.one_of(
    st.tuples(st.just("set"), KEYS, st.integers(0, 3)),
    st.tuples(st.just("drop"), KEYS, st.none()),
    st.tuples(st.just("append"), KEYS, st.integers(0, 99)),
    st.tuples(st.just("read"), st.integers(0, 1), st.none()),
)


class Reader:
    """What a browser keeps."""

    def __init__(self):
        self.revision, self.values, self.series = 0, {}, {}

    def read(self, channel):
        self.revision, text = channel.since(self.revision)
        told = {} if text is None else json.loads(text)
        self.values |= told.get("set", {})
        for key in told.get("drop", []):
            self.values.pop(key, None)
        for key, values in told.get("add", {}).items():
            self.series.setdefault(key, []).extend(values)


@settings(max_examples=50)
@given(st.lists(DOINGS, max_size=60))
def test_whoever_reads_and_when_the_end_is_the_same(doings):
    channel, readers = Channel(), [Reader(), Reader()]
    values, series = {}, {}
    for what, key, value in doings:
        if what == "set":
            channel.set(key, value)
            values[key] = value
        elif what == "drop":
            channel.drop(key)
            values.pop(key, None)
        elif what == "append":
            channel.append(key, value)
            series.setdefault(key, []).append(value)
        else:
            readers[key].read(channel)
    for reader in (*readers, Reader()):
        reader.read(channel)
        assert (reader.values, reader.series) == (values, series)


def test_what_has_not_changed_is_not_told_again():
    channel = Channel()
    channel.set("state", {"name": "Idle"})
    revision, _ = channel.since(0)
    channel.set("state", {"name": "Idle"})
    assert channel.since(revision) == (revision, None)


def test_a_late_reader_of_a_long_series_gets_its_end():
    channel = Channel()
    for number in range(2000):
        channel.append("events", number)
    assert json.loads(channel.since(0)[1])["add"]["events"] == list(range(1400, 2000))
