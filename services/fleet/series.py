"""Time series in which rhythms are sought: samples of one quantity, or how alike maps are by the time between them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Matrix = NDArray[np.float64]
Mask = NDArray[np.bool_]
Groups = NDArray[np.int64]

_MOST = 20_000
"""Most samples that an analysis works on; more are averaged within equal bins of time."""

_CENTRINGS = 6
"""Alternations of rows' and columns' means, each of which leaves a part of about 1 / n of the error."""
_MAPS = 300
"""Most maps whose pairs are worked on one by one."""


@dataclass(frozen=True, slots=True)
class Series:
    """N samples, ascending in time.

    Attributes:
        hours: (N,) their times.
        values: (N,).
        weights: (N,) how many measurements each stands for.
        lags: whether the times are those between two maps, so that what changes for good shows as ``|hours|`` grows.
        nuisance: (Q,) 1/hour, frequencies that lie under everything like the mean: none is sought there.
    """

    hours: Array
    values: Array
    weights: Array
    lags: bool = False
    nuisance: tuple[float, ...] = ()

    @classmethod
    def of(cls, hours: Array, values: Array) -> Self:
        """Samples in any order; many are averaged within bins, to at most twenty thousand."""
        order = np.argsort(hours, kind="stable")
        hours, values = hours[order], values[order]
        if len(hours) <= _MOST:
            return cls(hours, values, np.ones(len(hours)))
        bins = bins_of(hours, _MOST)
        count = np.bincount(bins, minlength=_MOST)
        kept = count > 0
        hours, values = (np.bincount(bins, part, minlength=_MOST)[kept] / count[kept] for part in (hours, values))
        return cls(hours, values, count[kept].astype(np.float64))

    @property
    def span(self) -> float:
        """Hours from the first sample to the last, or from the first map to the last."""
        return float(self.hours[-1] - (0.0 if self.lags else self.hours[0]))

    @property
    def independent(self) -> float:
        """Number of values less those that the mean and what lies under the rhythms take."""
        return len(self.hours) - 2.0 - 2.0 * len(self.nuisance)

    @property
    def shares(self) -> Array:
        """(N,) each sample's part of all measurements; the sum is 1."""
        shares: Array = self.weights / self.weights.sum()
        return shares


def bins_of(hours: Array, count: int) -> NDArray[np.int64]:
    """(N,) the number of the bin of each time, of ``count`` equal bins from the first time to the last."""
    first, last = float(hours.min()), float(hours.max())
    scale = count / (last - first) if last > first else 0.0
    return np.minimum(((hours - first) * scale).astype(np.int64), count - 1)


def compared(groups: Groups) -> Mask:
    """(n, n) which maps are compared: those of one group (n,), and none with itself."""
    mask: Mask = groups[:, None] == groups
    np.fill_diagonal(mask, val=False)
    return mask


def likeness(matrix: Matrix, groups: Groups | None = None) -> Matrix:
    """How alike maps are (n, n), on a scale on which the softmax and its sharpness beta do not matter.

    Of rows that went through (3.5) the logarithm is taken, which gives back what went in, up to beta and a constant a
    row. What a map has in common with all others (a dark image, a rich one) is no rhythm: the means of rows and columns
    are taken off. What is not compared, the diagonal above all, is zero, and the rest has variance 1, or is zero where
    all is alike. Only maps of one of the ``groups`` (n,) are compared, all of them where there are none.
    """
    values = np.array(matrix, dtype=np.float64)
    if groups is None and is_softmax(values):
        values = np.log(np.maximum(values, np.finfo(np.float64).tiny))
    mask = compared(_one_group(len(values)) if groups is None else groups)
    values = centred(values, mask)
    deviation = float(np.std(values[mask])) if mask.any() else 0.0
    scale = float(np.abs(matrix).max())
    return values / deviation if deviation > 1e-9 * scale else np.zeros_like(values)


def centred(matrix: Matrix, mask: Mask) -> Matrix:
    """A matrix (n, n) without the means of its rows and columns, where it is compared, and zero elsewhere."""
    values: Matrix = np.where(mask, matrix, 0.0)
    counts = np.maximum(1, mask.sum(axis=0))
    for _ in range(_CENTRINGS):
        for axis in (0, 1):
            means = values.sum(axis=axis) / counts
            values -= np.expand_dims(means, axis)
            values *= mask
    return values


def _one_group(count: int) -> Groups:
    return np.zeros(count, dtype=np.int64)


def evenly(count: int) -> NDArray[np.int64]:
    """The numbers of at most three hundred of ``count`` maps, evenly over their order."""
    return np.unique(np.linspace(0, count - 1, min(count, _MAPS)).astype(np.int64))


def is_softmax(matrix: Matrix) -> bool:
    """Whether the rows are probabilities, as (3.5) makes them."""
    return bool((matrix >= 0.0).all() and np.allclose(matrix.sum(axis=1), 1.0, atol=1e-6))


class Pairs:
    """All pairs of n maps, as a series over the time between the two: ``(s_i - s_j, A_ij)`` for all i other than j.

    Attributes:
        hours: (n,) when they were recorded.
        groups: (n,) the group of each; only maps of one group make a pair.
        mask: (n, n) which do.
        lags: (n, n) the time between two.
    """

    def __init__(self, hours: Array, groups: Groups | None = None) -> None:
        """Of maps recorded at ``hours`` (n,), all in one group where none are given."""
        self.hours = hours
        self.groups = _one_group(len(hours)) if groups is None else groups
        self.mask = compared(self.groups)
        self.lags = hours[:, None] - hours
        lags = self.lags[self.mask]
        self._order = np.argsort(lags, kind="stable") if len(lags) <= _MOST else None
        self._bins = bins_of(lags, _MOST)
        self._count = np.bincount(self._bins, minlength=_MOST)
        self._kept = self._count > 0
        if self._order is None:
            self._hours, self._weights = self._averaged(lags), self._count[self._kept].astype(np.float64)
        else:
            self._hours, self._weights = lags[self._order], np.ones(len(lags))

    def series(self, matrix: Matrix) -> Series:
        """The series of a matrix (n, n) of these maps; many pairs are averaged within bins of time."""
        return Series(self._hours, self.values(matrix), self._weights, lags=True)

    def values(self, matrix: Matrix) -> Array:
        """(N,) the values alone."""
        values: Array = matrix[self.mask]
        return self._averaged(values) if self._order is None else values[self._order]

    def _averaged(self, values: Array) -> Array:
        averaged: Array = np.bincount(self._bins, values, minlength=_MOST)[self._kept] / self._count[self._kept]
        return averaged
