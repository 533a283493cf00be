"""What the estimator owes to a map store that comes and goes: commits in order, submaps ahead of need."""

import threading

import pytest

from common.errors import NoAnswer, NoRouter, Refused, Unavailable
from common.ids import VertexId, new_map_id
from common.messages import Commit, Done, Keyframe, VertexRecord
from services.estimator.committer import Committer
from services.estimator.submaps import SubmapCache

MAP = new_map_id("r1", 1)


@pytest.fixture
def running():
    """Starts a function in a thread that ends with the test."""
    stop = threading.Event()
    threads = []

    def start(target):
        threads.append(threading.Thread(target=target, daemon=True))
        threads[-1].start()

    yield start, stop
    stop.set()
    for thread in threads:
        thread.join(5)
        assert not thread.is_alive()


def until(condition, deadline=5.0):
    """Waits for a condition that another thread brings about."""
    gate = threading.Event()
    for _ in range(int(deadline / 0.01)):
        if condition():
            return
        gate.wait(0.01)
    raise AssertionError("the condition did not come about")


def test_commits_are_repeated_in_order_until_answered(running):
    start, stop = running
    calls, outages = [], iter([NoAnswer, Unavailable, None, NoRouter, None, None])

    def send(commit):
        calls.append(commit.finished)
        outage = next(outages)
        if outage is not None:
            raise outage("away")
        return Done()

    committer = Committer(send, stop)
    maps = [new_map_id("r1", i) for i in range(3)]
    for map_id in maps:
        committer.put(Commit(finished=map_id))
    assert committer.unanswered == 3
    start(committer.run)
    until(lambda: committer.unanswered == 0)
    assert calls == [maps[0]] * 3 + [maps[1]] * 2 + [maps[2]]


def test_a_refusal_is_kept_and_does_not_hold_up_the_rest(running):
    start, stop = running
    answered = []

    def send(commit):
        if commit.finished == MAP:
            raise Refused("the map is unknown")
        answered.append(commit.finished)
        return Done()

    committer = Committer(send, stop)
    other = new_map_id("r1", 2)
    committer.put(Commit(finished=MAP))
    committer.put(Commit(finished=other))
    start(committer.run)
    until(lambda: committer.unanswered == 0)
    assert committer.refusal == "the map is unknown"
    assert answered == [other]


def vertices(count):
    return [VertexId(MAP, i) for i in range(count)]


def stored(vertex):
    return VertexRecord(id=vertex, stamp=vertex.index, keyframe=Keyframe(pipeline="stereo", arrays={}))


def test_wanted_submaps_arrive_although_the_store_is_away_at_first(running):
    start, stop = running
    away = iter([True, True])

    def fetch(wanted):
        if next(away, False):
            raise NoAnswer("away")
        return [stored(v) for v in wanted]

    cache = SubmapCache(fetch, lambda record: record.stamp)
    start(lambda: cache.run(stop))
    cache.want(vertices(20))
    until(lambda: all(cache.get(v) == v.index for v in vertices(20)))


def test_the_cache_forgets_what_was_used_longest_ago():
    cache = SubmapCache(lambda _wanted: [], lambda record: record.stamp, capacity=3)
    for vertex in vertices(3):
        cache.put(vertex, vertex.index)
    cache.get(VertexId(MAP, 0))
    cache.put(VertexId(MAP, 3), 3)
    assert cache.get(VertexId(MAP, 1)) is None
    assert cache.get(VertexId(MAP, 0)) == 0


def test_an_unreadable_submap_is_asked_for_once(running):
    start, stop = running
    asked = []

    def fetch(wanted):
        asked.extend(wanted)
        return [stored(v) for v in wanted]

    def read(record):
        if record.id.index == 1:
            raise ValueError("not whole")
        return record.stamp

    cache = SubmapCache(fetch, read)
    start(lambda: cache.run(stop))
    cache.want(vertices(3))
    until(lambda: cache.get(VertexId(MAP, 2)) is not None)
    cache.want(vertices(3))
    assert cache.get(VertexId(MAP, 1)) is None
    assert asked.count(VertexId(MAP, 1)) == 1


def test_a_vertex_that_the_store_does_not_know_keeps_no_other_away(running):
    start, stop = running

    def fetch(wanted):
        if VertexId(MAP, 1) in wanted:
            raise Refused("there is no such vertex")
        return [stored(v) for v in wanted]

    cache = SubmapCache(fetch, lambda record: record.stamp)
    start(lambda: cache.run(stop))
    cache.want(vertices(6))
    until(lambda: all(cache.get(v) is not None for v in vertices(6) if v.index != 1))
    assert cache.get(VertexId(MAP, 1)) is None
