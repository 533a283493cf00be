"""Rhythms in how alike maps are, by all rows of the similarity matrix.

Pairs of maps are not independent measurements: n maps make n (n - 1) pairs, but one odd map spoils 2 (n - 1) of them.
So a rhythm counts only if it is not found in the same matrix with the maps' times shuffled (a Mantel test).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from services.fleet import calendar
from services.fleet.fit import Fit, joint, refined
from services.fleet.many import LINE, MOST, Found
from services.fleet.periodogram import Grid, Periodogram
from services.fleet.series import Pairs, Series, evenly

Array = NDArray[np.float64]
Matrix = NDArray[np.float64]

_PERMUTATIONS = 199


def find(series: Series, pairs: Pairs, alike: Matrix, grid: Grid, wanted: float, random: np.random.Generator) -> Found:
    """Rhythms of maps with a likeness (n, n), from the series of their pairs; the maps' times ascend."""
    count = len(pairs.hours)
    chosen = evenly(count)
    some = np.ix_(chosen, chosen)
    periodogram = Periodogram(series.hours, series.shares, grid)
    test = _Shuffles(Pairs(pairs.hours[chosen], pairs.groups[chosen]), grid, random)
    frequencies, probabilities = np.empty(0), np.empty(0)
    while True:
        fit = joint(series, frequencies)
        left = alike[some] - _at(fit, series.hours, series.values - fit.residual, pairs.lags[some])
        merit = _merit(periodogram.powers(fit.residual[None]), count, grid, series.span, frequencies)[0]
        peak = float(grid.frequencies[int(merit.argmax())])
        probability = test.probability(left, series.span, frequencies)
        if probability > wanted or len(frequencies) == MOST:
            return Found(frequencies, probabilities, peak, probability, shuffled=test.powers)
        frequencies = refined(series, np.append(frequencies, peak))
        probabilities = np.append(probabilities, probability)


class _Shuffles:
    """How high the merits of shuffled maps go; ``powers`` are the highest of each shuffle of the whole likeness."""

    def __init__(self, pairs: Pairs, grid: Grid, random: np.random.Generator) -> None:
        self._pairs, self._grid, self._random, self._count = pairs, grid, random, len(pairs.hours)
        self._members = [np.flatnonzero(pairs.groups == group) for group in np.unique(pairs.groups)]
        series = self._pairs.series(np.zeros((self._count, self._count)))
        self._periodogram = Periodogram(series.hours, series.shares, grid)
        self.powers: tuple[float, ...] = ()

    def probability(self, left: Matrix, span: float, known: Array) -> float:
        """The rank of the highest merit of what is left to explain (n, n) among those of its shuffled copies."""
        orders = [np.arange(self._count), *(self._shuffled() for _ in range(_PERMUTATIONS))]
        values = np.array([self._pairs.values(left[np.ix_(order, order)]) for order in orders])
        powers = self._periodogram.powers(values)
        self.powers = self.powers or tuple(powers[1:].max(axis=1).tolist())
        highest = _merit(powers, self._count, self._grid, span, known).max(axis=1)
        return float((highest >= highest[0]).mean())

    def _shuffled(self) -> NDArray[np.int64]:
        """(n,) the maps in a random order, each in a place of its own group."""
        order = np.arange(self._count)
        for members in self._members:
            order[members] = self._random.permutation(members)
        return order


def _merit(power: Array, samples: int, grid: Grid, span: float, known: Array) -> Array:
    """(B, M) log-likelihoods and odds of all frequencies but those about the known ones."""
    merit: Array = -0.5 * samples * np.log1p(-np.minimum(power, 1.0 - 1e-12))
    merit += calendar.credit(grid.frequencies, 1.0 / span)
    for frequency in known:
        merit[:, np.abs(grid.frequencies - frequency) < LINE / span] = -np.inf
    return merit


def _at(fit: Fit, hours: Array, fitted: Array, lags: Matrix) -> Matrix:
    """(n, n) what a fit over a series says of each pair of maps: the waves exactly, the baseline by interpolation."""
    below: Matrix = np.interp(lags, hours, fitted - fit.waves.sum(axis=0))
    return below + fit.at(lags)
