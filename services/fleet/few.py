"""Several rhythms in few samples: all that are there are sought together, and tested together.

Where three rhythms are equally strong, none of them explains much alone, and in few samples the first peak of a
periodogram is as often as not a wrong one. So combinations of frequencies are searched (a beam search by orthogonal
least squares), and what a combination explains is compared with what the same search finds in the same values in a
random order. That test is exact for any distribution of the values, and for any number of rhythms that are tried.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from common.compiled import kernel
from services.fleet import calendar
from services.fleet.fit import baseline, detrended, joint, refined
from services.fleet.many import Found
from services.fleet.periodogram import Grid
from services.fleet.series import Series

Array = NDArray[np.float64]
Ids = NDArray[np.int64]

MOST = 4
"""Most rhythms that are sought together."""

_LEAST_BEAM, _WIDEST_BEAM = 4, 12
_WORK, _FEWEST = 15_000, 24
"""Frequencies times the combinations that are kept at each level, for so few samples; for more, less."""
_CALIBRATION, _PERMUTATIONS = 40, 199
_APART = 3
"""Steps of the grid by which two candidates differ at least."""
_MOST_VALUES = 250_000
"""Frequencies times samples that a search goes through in a moment."""
_SINGULAR, _EXACT = 1e-3, 1e-9
"""Determinant below which two waves are one, and the part of the variance that counts as explained in full."""


@dataclass(frozen=True, slots=True)
class Atoms:
    """What is fitted to N samples.

    Attributes:
        waves: (M, 2, N) for each of M frequencies two waves, orthonormal and without the baseline.
        credit: (M,) logarithm of each frequency's odds before anything was measured.
    """

    waves: Array
    credit: Array

    @classmethod
    def of(cls, series: Series, frequencies: Array, resolution: float) -> Self:
        """The waves at some frequencies (M,) at a series' times; ``resolution`` is one over its span."""
        turns = 2.0 * np.pi * np.outer(frequencies, series.hours)
        base, _ = np.linalg.qr(baseline(series).T)
        pairs = np.stack([np.cos(turns), np.sin(turns)], axis=1)
        pairs -= (pairs @ base) @ base.T
        first = pairs[:, :1] / np.maximum(np.linalg.norm(pairs[:, :1], axis=2, keepdims=True), 1e-9)
        rest = pairs[:, 1:] - (pairs[:, 1:] * first).sum(axis=2, keepdims=True) * first
        size = np.linalg.norm(rest, axis=2, keepdims=True)
        second = np.where(size > 1e-4, rest / np.maximum(size, 1e-12), 0.0)
        waves = np.ascontiguousarray(np.concatenate([first, second], axis=1))
        return cls(waves, calendar.credit(frequencies, resolution))

    def search(self, values: Array, depth: int) -> tuple[Array, Ids]:
        """The best combinations for values (N,) without a baseline: of 1 to ``depth`` frequencies.

        Returns the merit of the best of each number (depth,): logarithms of likelihood and of odds; and the numbers of
        the frequencies (depth, B, depth): in row k the B best, best first, of which the first k + 1 count; -1 for none.
        """
        size = float(values @ values)
        scaled = values / np.sqrt(size) if size > 0.0 else values
        beam = min(_WIDEST_BEAM, max(_LEAST_BEAM, _WORK * _FEWEST // self.waves[:, 0].size))
        return _beam(self.waves, self.credit, scaled, depth, beam)


def depth_for(samples: int) -> int:
    """How many rhythms can be sought together in so many samples: each has three parameters."""
    return max(1, min(MOST, (samples - 4) // 5))


def find(series: Series, grid: Grid, wanted: float, random: np.random.Generator) -> Found:
    """As few rhythms as explain the values so well that more are as good in shuffled values, all sought together."""
    candidates = _candidates(grid, len(series.hours), 1.0 / series.span)
    atoms = Atoms.of(series, candidates, 1.0 / series.span)
    depth = depth_for(len(series.hours))
    values = detrended(series)
    _, combinations = atoms.search(values, depth)
    frequencies, chance = np.empty(0), 0.0
    for count in range(depth + 1):
        left = joint(series, frequencies).residual
        following = chance_of_more(atoms, values, left, count, depth, wanted, random) if count < depth else 1.0
        if following > wanted:
            best = int(atoms.search(left, 1)[1][0, 0, 0])
            return Found(frequencies, np.full(count, chance), float(candidates[best]), following)
        chance = max(chance, following)
        frequencies = _best(series, atoms, candidates, combinations[count, :, : count + 1])
    raise AssertionError("the last count is always enough")


def _candidates(grid: Grid, samples: int, resolution: float) -> Array:
    """(M,) the grid's frequencies; of too many the lowest, and those about the calendar's.

    A few samples over years cannot tell ten thousand short periods apart, but they can tell a day.
    """
    frequencies = grid.frequencies
    near = np.abs(frequencies[:, None] - calendar.FREQUENCIES).min(axis=1) < resolution
    kept: Array = frequencies[near | (np.arange(grid.count) < _MOST_VALUES // samples)]
    return kept


def _best(series: Series, atoms: Atoms, frequencies: Array, combinations: Ids) -> Array:
    """(k,) the best of the combinations (B, k) once their frequencies are refined."""
    best, chosen = -np.inf, np.empty(0)
    for row in combinations[combinations[:, 0] >= 0]:
        candidate = refined(series, frequencies[row])
        left = max(float(joint(series, candidate).residual ** 2 @ series.shares), np.finfo(np.float64).tiny)
        merit = float(-0.5 * len(series.hours) * np.log(left) + atoms.credit[row].sum())
        if merit > best:
            best, chosen = merit, candidate
    return chosen


def chance_of_more(
    atoms: Atoms, values: Array, left: Array, count: int, depth: int, wanted: float, random: np.random.Generator
) -> float:
    """The probability that values (N,) that hold ``count`` waves and noise gain as much by waves more, up to ``depth``.

    The values are made anew from the fitted waves and what these leave (N,), in random orders. What j waves gain beyond
    ``count`` is measured in standard deviations from its mean over such copies, and the j that is farthest counts, in
    the values as in each copy. It ends early once the probability must exceed ``wanted``.
    """

    def gain(of: Array) -> Array:
        merit = atoms.search(of, depth)[0]
        return merit[count:] - (merit[count - 1] if count else 0.0)

    waves = values - left
    copies = np.array([gain(waves + random.permutation(left)) for _ in range(_CALIBRATION)])
    mean, deviation = copies.mean(axis=0), np.maximum(copies.std(axis=0), 1e-9)
    observed, as_good = float(((gain(values) - mean) / deviation).max()), 0
    for tried in range(1, _PERMUTATIONS + 1):
        other = gain(waves + random.permutation(left))
        as_good += float(((other - mean) / deviation).max()) >= observed
        if as_good + 1 > wanted * (_PERMUTATIONS + 1):
            return (as_good + 1) / (tried + 1)
    return (as_good + 1) / (_PERMUTATIONS + 1)


@kernel
def _beam(waves: Array, credit: Array, values: Array, depth: int, beam: int) -> tuple[Array, Ids]:
    """Beam search: at each level the ``beam`` best extensions of the combinations of the level before."""
    count = waves.shape[2]
    merits = np.zeros(depth)
    chosen = np.full((depth, beam, depth), -1, np.int64)
    paths, bases, owed = np.zeros((1, depth), np.int64), np.zeros((1, 2 * depth, count)), np.zeros(1)
    for level in range(depth):
        best_merits = np.full(beam, -np.inf)
        parents, picks = np.zeros(beam, np.int64), np.zeros(beam, np.int64)
        for node in range(len(paths)):
            merit = _merits(waves, bases[node, : 2 * level], values) + credit + owed[node]
            for _ in range(beam):
                pick = merit.argmax()
                total = merit[pick]
                if total <= best_merits[beam - 1]:
                    break
                merit[max(0, pick - _APART) : pick + _APART + 1] = -np.inf
                if not _known(paths, parents, picks, best_merits, node, pick, level):
                    _insert(best_merits, parents, picks, total, node, pick)
        found = max(1, (best_merits > -np.inf).sum())
        new_paths, new_bases = np.zeros((found, depth), np.int64), np.zeros((found, 2 * depth, count))
        new_owed = np.zeros(found)
        for k in range(found):
            new_paths[k], new_bases[k] = paths[parents[k]], bases[parents[k]]
            new_paths[k, level] = picks[k]
            new_owed[k] = owed[parents[k]] + credit[picks[k]]
            _extend(new_bases[k], 2 * level, waves[picks[k]])
        paths, bases, owed = new_paths, new_bases, new_owed
        merits[level] = max(best_merits[0], 0.0)
        chosen[level, :found] = paths
    return merits, chosen


@kernel
def _insert(merits: Array, parents: Ids, picks: Ids, merit: float, parent: int, pick: int) -> None:
    """Puts a candidate to its place among the best, and drops the last."""
    k = len(merits) - 1
    while k > 0 and merits[k - 1] < merit:
        merits[k], parents[k], picks[k] = merits[k - 1], parents[k - 1], picks[k - 1]
        k -= 1
    merits[k], parents[k], picks[k] = merit, parent, pick


@kernel
def _known(paths: Ids, parents: Ids, picks: Ids, merits: Array, node: int, pick: int, level: int) -> bool:
    """Whether the candidates hold the combination of a node with one more frequency, in another order."""
    for k in range(len(merits)):
        if merits[k] == -np.inf:
            break
        same = 0
        for i in range(level + 1):
            mine = pick if i == level else paths[node, i]
            for j in range(level + 1):
                other = picks[k] if j == level else paths[parents[k], j]
                if abs(mine - other) <= _APART:
                    same += 1
                    break
        if same == level + 1:
            return True
    return False


@kernel
def _merits(waves: Array, basis: Array, values: Array) -> Array:
    """(M,) log-likelihood of each frequency beside the orthonormal basis (q, N), for values (N,) of norm 1."""
    frequencies, _, count = waves.shape
    flat = waves.reshape(2 * frequencies, count)
    residual = values - np.dot(np.dot(basis, values), basis)
    left = (residual * residual).sum()
    onto = np.dot(flat, residual)
    shared = np.dot(flat, np.ascontiguousarray(basis.T))
    merits = np.full(frequencies, -np.inf)
    for m in range(frequencies):
        a, b = shared[2 * m], shared[2 * m + 1]
        aa, bb, ab = 1.0, 1.0, 0.0
        for q in range(shared.shape[1]):
            aa -= a[q] * a[q]
            bb -= b[q] * b[q]
            ab -= a[q] * b[q]
        determinant = aa * bb - ab * ab
        if determinant > _SINGULAR:
            x, y = onto[2 * m], onto[2 * m + 1]
            gain = (bb * x * x - 2.0 * ab * x * y + aa * y * y) / determinant
            merits[m] = -0.5 * count * np.log(max(left - gain, _EXACT))
    return merits


@kernel
def _extend(basis: Array, size: int, pair: Array) -> None:
    """Orthonormalises two more waves into rows ``size`` and ``size + 1`` of a basis."""
    for k in range(2):
        wave = pair[k].copy()
        for _ in range(2):  # twice is enough, against rounding
            for q in range(size + k):
                wave -= np.dot(basis[q], wave) * basis[q]
        norm = np.sqrt((wave * wave).sum())
        if norm > 1e-9:
            basis[size + k] = wave / norm
