"""Rhythms in many samples: one after another from the periodogram of what the others leave."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from services.fleet import calendar, false_alarm, harmonics
from services.fleet.fit import detrended, joint, refined
from services.fleet.periodogram import Grid, Periodogram
from services.fleet.series import Series

Array = NDArray[np.float64]

MOST = 8
"""Most rhythms that are sought."""

_PROMISING = 0.2
"""Chance up to which a peak is followed: several rhythms hide each other, and stand out once all are known."""
_OF_WEEK = 0.1
"""Part of the wanted probability of a false claim that the second look, for a week, may use."""
_PERMUTATIONS = 99
LINE = 1.5
"""Resolutions about a rhythm within which another peak is its own width, or its slow change."""


@dataclass(frozen=True, slots=True)
class Found:
    """Rhythms in the order in which they were found, and the probabilities that noise would have made them.

    Attributes:
        frequencies: (K,) 1/hour.
        probabilities: (K,).
        shuffled: the highest powers in the same maps in random orders, where maps were compared.
        by_harmonics: those frequencies that were found by their harmonics, not by a peak of their own.
        next_frequency, next_probability: the strongest peak that was not accepted.
    """

    frequencies: Array
    probabilities: Array
    next_frequency: float
    next_probability: float
    by_harmonics: tuple[float, ...] = ()
    shuffled: tuple[float, ...] = ()


def find(series: Series, grid: Grid, wanted: float, random: np.random.Generator) -> Found:
    """Rhythms that noise, white or restless, would not make with the ``wanted`` probability.

    Prewhitening: each peak is refined together with those before it, all are fitted jointly, and the next is sought in
    what they leave. At the end each has to stand out from what all the others leave. Nothing is sought in values that a
    wave explains as well in a random order.
    """
    periodogram = Periodogram(series.hours, series.shares, grid)
    frequencies, first = np.empty(0), 1.0
    values = detrended(series)
    while True:
        peak, chance = _strongest(series, periodogram, values, frequencies)
        if len(frequencies) == 0 and chance <= _PROMISING:
            first = _rank(periodogram, values, random)
        if chance > _PROMISING or first > _PROMISING or len(frequencies) == MOST:
            break
        frequencies = refined(series, np.append(frequencies, peak))
        values = joint(series, frequencies).residual
    found = _confirmed(series, periodogram, frequencies, wanted, Found(np.empty(0), np.empty(0), peak, chance))
    return _with_week(series, periodogram, found, wanted)


def _with_week(series: Series, periodogram: Periodogram, found: Found, wanted: float) -> Found:
    """What was found and the week, if that shows in its harmonics though its fundamental does not stand out."""
    chance = harmonics.chance_of_week(series, periodogram, found.frequencies)
    week = 1.0 / calendar.WEEK
    known = np.abs(found.frequencies - week).min(initial=np.inf) < LINE / series.span
    if known or chance > _OF_WEEK * wanted or week > periodogram.grid.frequencies[-1]:
        return found
    return dataclasses.replace(
        found,
        frequencies=np.append(found.frequencies, week),
        probabilities=np.append(found.probabilities, chance),
        by_harmonics=(week,),
    )


def _confirmed(series: Series, periodogram: Periodogram, frequencies: Array, wanted: float, none: Found) -> Found:
    """Those rhythms that stand out from what all the others leave, the least likely ones given up one by one."""
    found = none
    while len(frequencies):
        fit = joint(series, frequencies)
        chances = np.array(
            [
                _strongest(series, periodogram, fit.residual + wave, np.delete(frequencies, k), at=frequencies[k])[1]
                for k, wave in enumerate(fit.waves)
            ]
        )
        worst = int(chances.argmax())
        if chances[worst] <= wanted:
            return Found(frequencies, chances, found.next_frequency, found.next_probability)
        found = Found(np.empty(0), np.empty(0), float(frequencies[worst]), float(chances[worst]))
        frequencies = refined(series, np.delete(frequencies, worst))
    return found


def _strongest(
    series: Series, periodogram: Periodogram, values: Array, known: Array, at: float | None = None
) -> tuple[float, float]:
    """Frequency of the highest peak beside the known ones, or about ``at``, and the chance that noise is so high."""
    grid, resolution = periodogram.grid, 1.0 / series.span
    samples = series.independent - 3.0 * len(known)
    power = periodogram.power(values)
    apart = np.abs(grid.frequencies - known[:, None]).min(axis=0, initial=np.inf)
    power = power / false_alarm.background(power, grid.frequencies, samples, resolution)
    power[apart < LINE * resolution] = 0.0
    if at is not None:
        power[np.abs(grid.frequencies - at) > LINE * resolution] = 0.0
    place = int(power.argmax())
    deviation = float(np.sqrt(series.hours**2 @ series.shares))
    chance = false_alarm.probability(float(power[place]), samples, deviation, float(grid.frequencies[-1]))
    return float(grid.frequencies[place]), chance


def _rank(periodogram: Periodogram, values: Array, random: np.random.Generator) -> float:
    """The rank of the values' highest peak among those of the same values in random orders."""
    highest = periodogram.power(values).max()
    shuffled = periodogram.powers(np.array([random.permutation(values) for _ in range(_PERMUTATIONS)])).max(axis=1)
    return (int((shuffled >= highest).sum()) + 1) / (_PERMUTATIONS + 1)
