"""The week by its harmonics: what happens every Tuesday from nine to ten is no sinusoid.

Of such a rhythm the fundamental may be the least part. So the powers at the week's harmonics that are not the day's are
added up; in noise the sum of n of them has a Gamma distribution of that shape.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from services.fleet import calendar, false_alarm
from services.fleet.fit import joint
from services.fleet.periodogram import Grid, Periodogram
from services.fleet.series import Series

Array = NDArray[np.float64]

_HARMONICS = 20
_DAYS = 7
_LEAST_WEEKS = 4.0


def chance_of_week(series: Series, periodogram: Periodogram, known: Array) -> float:
    """The probability that noise makes as much of a week, beside the day and rhythms that are known (K,), 1/hour."""
    if series.span < _LEAST_WEEKS * calendar.WEEK:
        return 1.0
    day = np.arange(1, _HARMONICS // _DAYS + 2) / calendar.DAY
    apart = np.abs(day[:, None] - known).min(axis=1, initial=np.inf) > 1.0 / series.span
    values = joint(series, np.concatenate([known, day[apart]])).residual
    grid = periodogram.grid
    samples = len(values) - 2.0 - 3.0 * (len(known) + len(day))
    noise = false_alarm.background(periodogram.power(values), grid.frequencies, samples, 1.0 / series.span)
    comb = Grid(1.0 / calendar.WEEK, 1.0 / calendar.WEEK, _HARMONICS)
    chosen = (np.arange(1, _HARMONICS + 1) % _DAYS > 0) & (comb.frequencies <= grid.frequencies[-1])
    power = Periodogram(series.hours, series.shares, comb).power(values)
    sums = 0.5 * (samples - 3.0) * power / np.interp(comb.frequencies, grid.frequencies, noise)
    return _gamma_tail(float(sums[chosen].sum()), int(chosen.sum()))


def _gamma_tail(value: float, shape: int) -> float:
    """The probability that a sum of ``shape`` exponential numbers of mean 1 exceeds a value."""
    logs = [j * math.log(value) - math.lgamma(j + 1.0) for j in range(shape)] if value > 0.0 else [0.0]
    highest = max(logs)
    return min(1.0, math.exp(highest - value) * sum(math.exp(one - highest) for one in logs))
