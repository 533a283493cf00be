"""Periods that the times of the samples cannot tell apart, whatever was measured at them."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from services.fleet import calendar, false_alarm
from services.fleet.fit import Fit, joint
from services.fleet.periodogram import Grid, Periodogram, transform
from services.fleet.series import Series

Array = NDArray[np.float64]

_ALIKE = 0.97
"""Part of one wave's variance, of the best phase, that another one explains when both are the same to the samples."""
_HALF_DAY, _HALF_DAY_OF_LAGS = 0.93, 0.8
"""The same for a day and half a day: times within 12 hours of the day, and maps recorded within 8.

A daily rhythm is no pure cosine, and its harmonics then decide which of the two fits better. Of lags, which reach to
either side, twice as much of the day is seen.
"""
_EVIDENCE = np.log(10.0)
"""Logarithm of the odds by which a period has to surpass every other one in its place."""
_LINE = 1.5
"""Resolutions about a frequency that are its own peak."""
_EVEN = 0.98
"""Size of the times' own transform at which they lie on an even grid of that frequency."""


@dataclass(frozen=True, slots=True)
class Rival:
    """A frequency, 1/hour, that could stand in another's place, and whether the times alone make the two the same."""

    frequency: float
    same: bool


def highest_told(series: Series, highest: float) -> float:
    """The highest frequency, up to ``highest``, 1/hour, that the times can show: half their rate where they are even.

    Times that lie within some hours of the day count as one a day.
    """
    if half_days(series):
        highest = min(highest, 0.5 / calendar.DAY)
    grid = Grid.between(2.0 / series.span, 2.0 * highest, series.span, 4.0)
    even = np.flatnonzero(np.abs(transform(series.hours, series.shares[None], grid)[0]) > _EVEN)
    return min(highest, 0.5 * float(grid.frequencies[even[0]])) if len(even) else highest


def half_days(series: Series) -> bool:
    """Whether the times cannot tell a day from half a day: they lie within some hours of the day, office hours say."""
    if series.span < 2.0 * calendar.DAY:
        return False
    half = Grid(2.0 / calendar.DAY, 1.0 / series.span, 1)
    limit = _HALF_DAY_OF_LAGS if series.lags else _HALF_DAY
    return float(alikeness(series, half, 1.0 / calendar.DAY)[0]) > limit


def evidence_of(series: Series, frequencies: Array) -> float:
    """Log-likelihood by which waves of some frequencies (K,) explain the values better than none."""
    without = float(joint(series, np.empty(0)).residual ** 2 @ series.shares)
    left = float(joint(series, frequencies).residual ** 2 @ series.shares)
    return 0.5 * len(series.hours) * math.log(without / left) if left > 0.0 else math.inf


def rivals(series: Series, grid: Grid, fit: Fit, samples: float, by_harmonics: tuple[float, ...]) -> list[Rival | None]:
    """For each rhythm of a joint fit, what could as well stand in its place, None where there is nothing.

    Two ways lead there: the two waves are nearly one at the samples' times; or the values fit the other nearly as well,
    likelihoods being those of ``samples`` independent ones beside noise that need not be white. The latter says nothing
    of rhythms that were found by their harmonics.
    """
    periodogram = Periodogram(series.hours, series.shares, grid)
    frequencies, resolution = grid.frequencies, 1.0 / series.span
    credit = calendar.credit(frequencies, resolution)
    noise = false_alarm.background(periodogram.power(fit.residual), frequencies, samples, resolution)
    found: list[Rival | None] = []
    for k, frequency in enumerate(fit.frequencies):
        power = periodogram.power(fit.residual + fit.waves[k])
        evidence = -0.5 * samples * np.log1p(-np.minimum(power / noise, 1.0 - 1e-12))
        own = np.abs(frequencies - frequency) < _LINE * resolution
        best = float((evidence + credit)[own].max(initial=-np.inf))
        same = ~own & (alikeness(series, grid, float(frequency)) > _ALIKE)
        as_good = ~own & (evidence + credit > best - _EVIDENCE) & (float(frequency) not in by_harmonics)
        rival = np.where(same | as_good, evidence + credit, -np.inf)
        place = int(rival.argmax())
        found.append(Rival(float(frequencies[place]), bool(same[place])) if np.isfinite(rival[place]) else None)
    return found


def alikeness(series: Series, grid: Grid, frequency: float) -> Array:
    """(M,) the largest part of a wave of ``frequency`` that a wave of each of the grid's explains at these times.

    The square of the first canonical correlation of the two pairs of waves, the constant taken off. How alike maps are
    depends on the size of a lag alone, so there the cosines are compared alone.
    """
    shares = series.shares
    turns = 2.0 * np.pi * frequency * series.hours
    own = np.stack([np.cos(turns), np.sin(turns)])
    own = own - (own @ shares)[:, None]
    across = transform(series.hours, own * shares, grid)
    cross = np.stack([across.real, across.imag], axis=-1)  # (2, M, 2): own wave, frequency, the other's wave
    other = _moments(series, grid)
    mine = (own * shares) @ own.T
    if series.lags:
        alike: Array = cross[0, :, 0] ** 2 / np.maximum(mine[0, 0] * other[:, 0, 0], 1e-12)
        return np.minimum(alike, 1.0)
    inverse = np.linalg.inv(other + 1e-9 * np.eye(2))
    product = np.linalg.inv(mine + 1e-9 * np.eye(2)) @ np.einsum("imj,mjk,lmk->mil", cross, inverse, cross)
    half, determinant = 0.5 * np.trace(product, axis1=1, axis2=2), np.linalg.det(product)
    largest: Array = half + np.sqrt(np.maximum(half**2 - determinant, 0.0))
    return np.clip(largest, 0.0, 1.0)


def _moments(series: Series, grid: Grid) -> Array:
    """(M, 2, 2) variances and covariance of cosine and sine at each frequency of the grid."""
    shares = series.shares[None]
    window = transform(series.hours, shares, grid)[0]
    double = transform(series.hours, shares, Grid(2 * grid.first, 2 * grid.step, grid.count))[0]
    moments = np.empty((grid.count, 2, 2))
    moments[:, 0, 0] = 0.5 * (1.0 + double.real) - window.real**2
    moments[:, 1, 1] = 0.5 * (1.0 - double.real) - window.imag**2
    moments[:, 0, 1] = moments[:, 1, 0] = 0.5 * double.imag - window.real * window.imag
    return moments
