"""Hash tables over binary descriptors of 256 bits.

Multi-index hashing (M. Norouzi, A. Punjani and D. Fleet, *Fast search in Hamming space with multi-index hashing*, CVPR
2012): a descriptor is cut into 16 keys of 16 bits, a table each. Two descriptors of less than 16 differing bits have a
key in common; two of less than 32 have keys that differ in one bit at most, which are looked up as well. Of those
that differ in more, a part is missed: 7 % at 50 bits.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from common.compiled import kernel
from services.estimator.stereo.brief import BYTES, as_words, hamming

TABLES = BYTES // 2
_KEYS = 1 << 16
_PROBES = 17
"""A key itself, and the 16 that differ from it in one bit."""

_UNSEEN = 257

Descriptors = NDArray[np.uint8]
Words = NDArray[np.uint64]
Keys = NDArray[np.uint16]
Ints = NDArray[np.int32]


class Tables(NamedTuple):
    """N descriptors of V vertices, ready to be asked.

    Attributes:
        words: (N, 4), the descriptors.
        owners: (N,) the vertex of each.
        starts: (16, 65537); bucket ``k`` of table ``t`` is ``members[t, starts[t, k] : starts[t, k + 1]]``.
        members: (16, N) indices of descriptors.
        groups: (V,) to which group of vertices that see the same things each belongs.
        group_count: of the groups.
    """

    words: Words
    owners: Ints
    starts: Ints
    members: Ints
    groups: Ints
    group_count: int


def build(descriptors: Descriptors, owners: Ints, groups: Ints) -> Tables:
    """Tables of descriptors (N, 32), each with its vertex (N,), and of the V vertices' groups (V,)."""
    keys = np.ascontiguousarray(descriptors).view(np.uint16)
    starts, members = _sort_into_buckets(keys)
    group_count = int(groups.max(initial=-1)) + 1
    return Tables(as_words(descriptors), owners, starts, members, groups, group_count)


def votes(tables: Tables, queries: Descriptors, max_distance: int, max_bucket: int) -> NDArray[np.float64]:
    """How much each vertex (V,) looks like what the queries (M, 32) describe.

    A query votes for every vertex that has a descriptor within ``max_distance`` bits, the more the nearer that is,
    weighted by ``log(1 + G / g)``, its inverse frequency among the G groups, of which it was found in g. Buckets of
    more than ``max_bucket`` descriptors tell nothing apart and are passed over.
    """
    keys = np.ascontiguousarray(queries).view(np.uint16)
    return _votes(
        tables.words, tables.owners, tables.starts, tables.members, tables.groups, tables.group_count,
        as_words(queries), keys, max_distance, max_bucket,
    )  # fmt: skip


@kernel
def _sort_into_buckets(keys: Keys) -> tuple[Ints, Ints]:
    """Each table's descriptors sorted by their key: a counting sort."""
    n = keys.shape[0]
    starts = np.zeros((TABLES, _KEYS + 1), np.int32)
    members = np.empty((TABLES, n), np.int32)
    for table in range(TABLES):
        begin = starts[table]
        for i in range(n):
            begin[int(keys[i, table]) + 1] += 1
        for key in range(_KEYS):
            begin[key + 1] += begin[key]
        fill = begin[:_KEYS].copy()
        for i in range(n):
            key = int(keys[i, table])
            members[table, fill[key]] = i
            fill[key] += 1
    return starts, members


@kernel
def _look_up(
    key: int,
    query: Words,
    words: Words,
    owners: Ints,
    starts: Ints,
    members: Ints,
    nearest: NDArray[np.int16],
    touched: Ints,
    count: int,
    max_distance: int,
    max_bucket: int,
) -> int:
    """Takes a bucket's descriptors into each vertex's ``nearest``; returns how many vertices are touched by now."""
    begin, end = starts[key], starts[key + 1]
    if end - begin > max_bucket:
        return count
    for place in range(begin, end):
        i = members[place]
        distance = hamming(query, words[i])
        if distance <= max_distance:
            vertex = owners[i]
            if nearest[vertex] == _UNSEEN:
                touched[count] = vertex
                count += 1
            nearest[vertex] = min(nearest[vertex], distance)
    return count


@kernel
def _tally(
    scores: NDArray[np.float64],
    nearest: NDArray[np.int16],
    touched: Ints,
    groups: Ints,
    group_count: int,
    seen_by: NDArray[np.int64],
    query: int,
    max_distance: int,
) -> None:
    """Gives the touched vertices the votes of one query, and forgets their ``nearest``."""
    found_in = 0
    for vertex in touched:
        if seen_by[groups[vertex]] != query:
            seen_by[groups[vertex]] = query
            found_in += 1
    for vertex in touched:
        rarity = np.log(1.0 + group_count / found_in)
        scores[vertex] += rarity * (1.0 - nearest[vertex] / (max_distance + 1.0))
        nearest[vertex] = _UNSEEN


@kernel
def _votes(
    words: Words,
    owners: Ints,
    starts: Ints,
    members: Ints,
    groups: Ints,
    group_count: int,
    queries: Words,
    keys: Keys,
    max_distance: int,
    max_bucket: int,
) -> NDArray[np.float64]:
    vertex_count = groups.shape[0]
    scores = np.zeros(vertex_count)
    nearest = np.full(vertex_count, _UNSEEN, np.int16)
    touched = np.zeros(vertex_count, np.int32)
    seen_by = np.full(group_count, -1, np.int64)
    for q in range(queries.shape[0]):
        count = 0
        for table in range(TABLES):
            key = int(keys[q, table])
            for bit in range(_PROBES):
                probed = key if bit == 0 else key ^ (1 << (bit - 1))
                count = _look_up(
                    probed, queries[q], words, owners, starts[table], members[table], nearest, touched, count,
                    max_distance, max_bucket,
                )  # fmt: skip
        _tally(scores, nearest, touched[:count], groups, group_count, seen_by, q, max_distance)
    return scores
