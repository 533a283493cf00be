"""The index against brute force, and what it makes of rarity, removal and bounds."""

from __future__ import annotations

import numpy as np
import pytest

from common.ids import VertexId, new_map_id
from services.estimator.relocalization import AppearanceIndex, RelocalizationSettings
from services.estimator.relocalization import tables as hashing

MAPS = [new_map_id("r1", i * 10**9) for i in range(3)]


def random(rng, count):
    return rng.integers(0, 256, (count, 32), dtype=np.uint8)


def blurred(rng, descriptors, bits):
    """The descriptors with some of their bits turned over, each in places of its own."""
    flips = np.argsort(rng.random((len(descriptors), 256)), axis=1) < bits
    return descriptors ^ np.packbits(flips, axis=1)


def brute_force(descriptors, owners, groups, queries, max_distance):
    """The votes by comparing everything with everything."""
    scores = np.zeros(len(groups))
    for query in queries:
        distance = np.unpackbits(descriptors ^ query, axis=1).sum(axis=1)
        nearest = {}
        for d, owner in zip(distance, owners, strict=True):
            if d <= max_distance:
                nearest[owner] = min(d, nearest.get(owner, 257))
        found_in = {groups[owner] for owner in nearest}
        for owner, d in nearest.items():
            scores[owner] += np.log(1 + (groups.max() + 1) / len(found_in)) * (1 - d / (max_distance + 1))
    return scores


@pytest.mark.parametrize("seed", range(4))
def test_the_votes_are_those_of_brute_force_where_no_descriptor_can_be_missed(seed):
    rng = np.random.default_rng(seed)
    landmarks = random(rng, 40)
    owners = np.sort(rng.integers(0, 12, 300)).astype(np.int32)
    groups = (np.arange(12) // 3).astype(np.int32)
    descriptors = blurred(rng, landmarks[rng.integers(0, 40, 300)], 10)
    queries = np.concatenate([blurred(rng, landmarks, 10), random(rng, 10)])
    tables = hashing.build(descriptors, owners, groups)
    # Sixteen keys, each looked up with one bit turned over: less than 32 differing bits are always found.
    expected = brute_force(descriptors, owners, groups, queries, 31)
    np.testing.assert_allclose(hashing.votes(tables, queries, 31, 10**6), expected)
    assert expected.max() > 0


@pytest.mark.parametrize(("bits", "least"), [(20, 1.0), (40, 0.97), (48, 0.9)])
def test_few_of_the_descriptors_that_differ_in_more_bits_are_missed(bits, least):
    rng = np.random.default_rng(5)
    descriptors = random(rng, 2000)
    tables = hashing.build(descriptors, np.arange(2000, dtype=np.int32), np.arange(2000, dtype=np.int32))
    found = [
        hashing.votes(tables, query[None], 48, 10**6)[i] > 0 for i, query in enumerate(blurred(rng, descriptors, bits))
    ]
    assert np.mean(found) >= least


def test_a_key_that_nearly_everything_shares_is_passed_over():
    rng = np.random.default_rng(6)
    descriptors = random(rng, 50)
    descriptors[:, :2] = 0
    tables = hashing.build(descriptors, np.arange(50, dtype=np.int32), np.zeros(50, np.int32))
    only_that_key = random(rng, 1)
    only_that_key[:, :2] = 0
    assert (hashing.votes(tables, only_that_key, 256, 1000) > 0).all()
    assert not hashing.votes(tables, only_that_key, 256, 10).any()


class Places:
    """Places on some maps, each with landmarks of its own beside those that all places have."""

    def __init__(self, seed=0, vertices=30):
        self.rng = np.random.default_rng(seed)
        self.common = random(self.rng, 40)
        self.names = [VertexId(map_id, i) for map_id in MAPS for i in range(vertices)]
        self.own = {name: random(self.rng, 30) for name in self.names}
        self.index = AppearanceIndex()
        for name in self.names:
            self.index.add(name, {"plain": self.seen(name, 10)})

    def seen(self, name, bits):
        return blurred(self.rng, np.concatenate([self.own[name], self.common]), bits)


@pytest.fixture(scope="module")
def places():
    return Places()


def test_every_place_is_recognised_by_its_own_landmarks(places):
    for name in places.names:
        ranked = places.index.rank({"plain": places.seen(name, 40)})
        assert ranked[0][0] == name
        assert ranked[0][1] > 1.5 * ranked[1][1], "what all places have tells little"


def test_two_streams_add_up_and_are_never_compared_with_each_other():
    rng = np.random.default_rng(1)
    a, b = (VertexId(MAPS[0], i) for i in range(2))
    plain, invariant = random(rng, 20), random(rng, 20)
    index = AppearanceIndex()
    index.add(a, {"plain": plain, "invariant": invariant})
    index.add(b, {"plain": invariant, "invariant": plain})
    (first, both), *rest = index.rank({"plain": plain, "invariant": invariant})
    assert (first, rest) == (a, [])
    ((_, alone),) = index.rank({"plain": plain})
    assert both == pytest.approx(2 * alone)
    assert index.rank({"lidar": plain}) == []


def test_vertices_come_and_go():
    places = Places(seed=2, vertices=5)
    name = VertexId(MAPS[1], 3)
    seen = {"plain": places.seen(name, 20)}
    places.index.remove_map(MAPS[1])
    assert name not in places.index
    assert len(places.index) == 10
    assert all(v.map_id != MAPS[1] for v, _ in places.index.rank(seen))
    places.index.add(name, {"plain": places.seen(name, 10)})
    assert places.index.rank(seen)[0][0] == name


def test_an_empty_index_and_an_empty_frame_find_nothing():
    index = AppearanceIndex()
    nothing = np.zeros((0, 32), np.uint8)
    assert index.rank({"plain": random(np.random.default_rng(0), 5)}) == []
    index.add(VertexId(MAPS[0], 0), {"plain": nothing})
    assert index.rank({"plain": nothing}) == []
    assert len(index) == 1


def test_no_vertex_takes_more_than_its_share():
    index = AppearanceIndex(RelocalizationSettings(descriptors=20))
    many = random(np.random.default_rng(3), 500)
    index.add(VertexId(MAPS[0], 0), {"plain": many})
    kept = next(iter(index._vertices.values()))["plain"]
    assert len(kept) == 20
    assert np.array_equal(kept[[0, -1]], many[[0, -1]])
