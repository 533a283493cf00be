"""The rhythms of an environment: the parameters T_i, w_i, phi_i and a of its model, from samples or from its maps."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial

import numpy as np
from numpy.typing import NDArray

from services.fleet import calendar, confusion, false_alarm, few, many, maps, trend, wording
from services.fleet.fit import Fit, detrended, joint
from services.fleet.many import Found
from services.fleet.periodogram import Grid, Periodogram
from services.fleet.series import Groups, Matrix, Pairs, Series, likeness

Array = NDArray[np.float64]

LEVELS = (0.1, 0.01, 0.001)
"""False-alarm probabilities whose powers a picture shows."""

_LEAST_SAMPLES, _LEAST_MAPS = 8, 6
_FEW = 100
"""Most samples among which combinations are sought; in more, each rhythm stands out alone."""
_CYCLES = 1.5
"""How often a period has to pass at least."""
_OVERSAMPLING = 6.0
_MOST_FREQUENCIES = 20_000
_ROUNDING = 4.5
"""Log-likelihood that a period may cost when the calendar's own takes its place: three standard deviations."""


@dataclass(frozen=True, slots=True)
class Settings:
    """How rhythms are sought.

    Attributes:
        level: probability, by chance, of a claim where there is no rhythm.
        shortest_hours: the shortest period that is sought.
        seed: of the random orders of the tests; one seed, one answer.
    """

    level: float = 0.01
    shortest_hours: float = 3.0
    seed: int = 0


@dataclass(frozen=True, slots=True)
class Spectrum:
    """K rhythms, strongest first, and why there are no others.

    Attributes:
        periods_hours, weights, phases: (K,) T_i, w_i and phi_i (radians) of (3.1), for times on the samples' own axis.
        significance: (K,) the probability that noise alone would have shown such a rhythm.
        trend_per_hour: a of (3.2), 1/hour, where maps were compared.
        reason: a sentence: what was found in how much, what was not and why.
        frequencies, power: (M,) 1/hour, and the part of the values' variance that each explains alone.
        levels: false-alarm probability to power.
    """

    periods_hours: Array = field(default_factory=lambda: np.empty(0))
    weights: Array = field(default_factory=lambda: np.empty(0))
    phases: Array = field(default_factory=lambda: np.empty(0))
    significance: Array = field(default_factory=lambda: np.empty(0))
    trend_per_hour: float = 0.0
    reason: str = ""
    frequencies: Array = field(default_factory=lambda: np.empty(0))
    power: Array = field(default_factory=lambda: np.empty(0))
    levels: dict[float, float] = field(default_factory=dict)


def of_series(hours: Array, values: Array, settings: Settings = Settings()) -> Spectrum:
    """The rhythms of a quantity that was sampled at times (N,), hours on any axis, in any order."""
    what = f"{len(hours)} sample{'' if len(hours) == 1 else 's'}"
    lack = _lack(hours, values, len(hours), _LEAST_SAMPLES, what, settings)
    if lack:
        return Spectrum(reason=lack)
    origin = float(hours.mean())
    series = _with_nuisance(Series.of(hours - origin, values / np.abs(values).max()))
    grid = _grid(series, settings)
    random = np.random.default_rng(settings.seed)
    find = few.find if len(hours) <= _FEW else many.find
    found = find(series, grid, settings.level, random)
    return _result(series, grid, found, len(hours), origin, what, settings)[0]


def of_maps(hours: Array, matrix: Matrix, settings: Settings = Settings(), groups: Groups | None = None) -> Spectrum:
    """The rhythms of an environment of maps recorded at ``hours`` (n,), any order, from their similarities (n, n).

    The matrix holds likelihoods (3.4), or rows that went through (3.5). Maps of different ``groups`` (n,), those of
    different routes, were not compared with each other: their places in the matrix are not looked at.
    """
    what = f"{len(hours)} map{'' if len(hours) == 1 else 's'}"
    alike = likeness(matrix, groups) if len(hours) > 1 else np.zeros((1, 1))
    lack = _lack(hours, alike, len(hours), _LEAST_MAPS, what, settings)
    if lack:
        return Spectrum(reason=lack)
    order = np.argsort(hours, kind="stable")
    hours, alike = hours[order], alike[np.ix_(order, order)]
    pairs = Pairs(hours, None if groups is None else groups[order])
    series = _with_nuisance(pairs.series(alike))
    grid = _grid(series, settings)
    found = maps.find(series, pairs, alike, grid, settings.level, np.random.default_rng(settings.seed))
    result, waves, swing = _result(series, grid, found, len(hours), 0.0, what, settings)
    return dataclasses.replace(result, trend_per_hour=trend.rate(pairs, alike, waves, swing))


def _lack(hours: Array, values: Array, count: int, least: int, what: str, settings: Settings) -> str:
    """Why there can be no answer, empty if there can."""
    if count < least:
        return f"not enough data: {what}, and at least {least} are needed to tell a rhythm from chance"
    span = float(np.ptp(hours))
    if span < 2.0 * settings.shortest_hours:
        return (
            f"not enough data: {what} within {span:.1f} h cannot show a period of {settings.shortest_hours:g} h twice"
        )
    if np.ptp(values) == 0.0:
        return f"not enough data: {what}, all the same"
    return ""


def _with_nuisance(series: Series) -> Series:
    """The series, with waves of a day and of half a day under it where its times cannot tell them apart."""
    if not confusion.half_days(series):
        return series
    return dataclasses.replace(series, nuisance=(1.0 / calendar.DAY, 2.0 / calendar.DAY))


def _grid(series: Series, settings: Settings) -> Grid:
    """The frequencies that the samples can show: from 1.5 cycles in all to the shortest period that is sought."""
    lowest = _CYCLES / series.span
    highest = confusion.highest_told(series, max(1.0 / settings.shortest_hours, 2.0 * lowest))
    highest = min(highest, lowest + _MOST_FREQUENCIES / series.span)
    return Grid.between(lowest, max(highest, lowest), series.span, _OVERSAMPLING)


def _result(
    series: Series, grid: Grid, found: Found, samples: int, origin: float, what: str, settings: Settings
) -> tuple[Spectrum, Callable[[Array], Array], float]:
    """The found rhythms fitted jointly, without those that another could stand for, strongest first.

    With it their sum at any times, and the difference of values that the cyclic cost calls 1.
    """
    independent = min(samples, len(series.hours))
    fit = joint(series, _to_calendar(series, found.frequencies, independent))
    rivals = confusion.rivals(series, grid, fit, float(independent), found.by_harmonics)
    order = [int(k) for k in np.argsort(-fit.amplitudes) if rivals[k] is None]
    periods = 1.0 / fit.frequencies[order]
    phases = fit.phases[order] + 2.0 * np.pi * fit.frequencies[order] * origin
    weights, swing = _weights(series, fit, order)
    spectrum = Spectrum(
        periods_hours=periods,
        weights=weights,
        phases=np.mod(phases + np.pi, 2.0 * np.pi) - np.pi,
        significance=found.probabilities[order],
        reason=wording.reason(
            what, series, periods, found, rivals, float(grid.frequencies[-1]), settings.shortest_hours
        ),
        frequencies=grid.frequencies,
        power=Periodogram(series.hours, series.shares, grid).power(detrended(series)),
        levels=_levels(series, grid, found),
    )
    return spectrum, partial(fit.at, chosen=order), swing


def _levels(series: Series, grid: Grid, found: Found) -> dict[float, float]:
    """The powers that chance reaches with some probabilities: by shuffled maps, or by white noise."""
    if found.shuffled:
        return {p: float(np.quantile(found.shuffled, 1.0 - p)) for p in LEVELS if p * len(found.shuffled) >= 1.0}
    deviation, highest = float(np.sqrt(series.hours**2 @ series.shares)), float(grid.frequencies[-1])
    return {p: false_alarm.level(p, series.independent, deviation, highest) for p in LEVELS}


def _to_calendar(series: Series, frequencies: Array, samples: int) -> Array:
    """(K,) the frequencies, with the calendar's own in place of those that are the same as far as can be told."""
    current = np.array(frequencies)

    def left(candidate: Array) -> float:
        return max(float(joint(series, candidate).residual ** 2 @ series.shares), 1e-300)

    for k in range(len(current)):
        nearest = float(calendar.FREQUENCIES[np.abs(calendar.FREQUENCIES - current[k]).argmin()])
        candidate = np.array(current)
        candidate[k] = nearest
        near = abs(nearest - current[k]) < 0.5 / series.span
        if near and 0.5 * samples * np.log(left(candidate) / left(current)) < _ROUNDING:
            current = candidate
    return current


def _weights(series: Series, fit: Fit, order: list[int]) -> tuple[Array, float]:
    """(K,) w_i of (3.1), and the difference of the values that its cost calls 1.

    ``w_i = R K a_i / sum_j a_j``: proportional to the amplitudes, and so large that rhythms that explain everything
    make the cost go from 0 to 1 however many they are, whatever the values' unit; R, the multiple correlation, takes
    back what they do not explain.
    """
    amplitudes = fit.amplitudes[order]
    total = float(amplitudes.sum())
    if total == 0.0:
        return np.zeros(len(order)), 0.0
    all_of_it = float(detrended(series) ** 2 @ series.shares)
    correlation = float(np.sqrt(max(0.0, 1.0 - float(fit.residual**2 @ series.shares) / all_of_it)))
    return correlation * len(order) * amplitudes / total, 2.0 * total / max(correlation, 1e-12)
