"""Sinusoids fitted jointly: frequencies by Gauss-Newton, amplitudes and phases by regularised least squares."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from services.fleet.series import Series

Array = NDArray[np.float64]

_STEPS = 25
_DECAYS = 6.0
"""How many times likeness falls to 1/e over the span, in the exponential under the rhythms of maps."""
_CONVERGED = 1e-7
"""Step of a frequency, in its resolution, at which it no longer matters."""


@dataclass(frozen=True, slots=True)
class Fit:
    """K sinusoids over a baseline: ``sum_k a_k cos(2 pi f_k hours - phi_k)``.

    Attributes:
        frequencies: (K,) 1/hour.
        amplitudes: (K,).
        phases: (K,) radians in [-pi, pi).
        waves: (K, N) each sinusoid at the samples.
        residual: (N,) what is left of the values.
    """

    frequencies: Array
    amplitudes: Array
    phases: Array
    waves: Array
    residual: Array

    def at(self, hours: Array, chosen: Sequence[int] | None = None) -> Array:
        """The sum of the sinusoids, or of chosen ones, at other times, of any shape."""
        total = np.zeros_like(hours)
        for k in range(len(self.frequencies)) if chosen is None else chosen:
            total += self.amplitudes[k] * np.cos(2.0 * np.pi * self.frequencies[k] * hours - self.phases[k])
        return total


def baseline(series: Series) -> Array:
    """(B, N) what may lie under a rhythm: a constant, a slope over time or the size of a lag, nuisance waves.

    Maps that lose likeness for good do so fast at first (3.2), so over lags an exponential is beside the slope.
    """
    hours = np.abs(series.hours) if series.lags else series.hours
    slope = hours - hours @ series.shares
    size = float(np.sqrt(slope**2 @ series.shares))
    turns = 2.0 * np.pi * np.outer(series.nuisance, series.hours)
    waves = [*np.cos(turns), *np.sin(turns)]
    if series.lags:
        waves.append(np.exp(-_DECAYS * hours / series.span))
    return np.stack([np.ones(len(hours)), slope / size if size > 0.0 else slope, *waves])


def detrended(series: Series) -> Array:
    """(N,) the values without their baseline."""
    return joint(series, np.empty(0)).residual


def joint(series: Series, frequencies: Array) -> Fit:
    """Amplitudes and phases of all frequencies (K,) at once, over the baseline.

    Ridge regression, with as much regularisation as noise says (the noise's variance over a wave's): well-sampled waves
    keep their amplitude, and two that the samples hardly tell apart do not cancel each other with huge ones.
    """
    root = np.sqrt(series.shares)
    turns = 2.0 * np.pi * np.outer(frequencies, series.hours)
    base = baseline(series)
    columns = np.concatenate([base, np.cos(turns), np.sin(turns)])
    plain = _solve(columns * root, series.values * root, 0.0)
    free = max(len(series.hours) - len(columns), 1)
    noise = float((series.values - plain @ columns) ** 2 @ series.shares) / free
    count, spare = len(frequencies), len(base)
    strength = float((plain[spare:] ** 2).sum()) / max(1, 2 * count)
    ridge = noise / strength if strength > 0.0 else 0.0
    coefficients = _solve(columns * root, series.values * root, ridge, spare=spare)
    a, b = coefficients[spare : spare + count], coefficients[spare + count :]
    waves = a[:, None] * columns[spare : spare + count] + b[:, None] * columns[spare + count :]
    return Fit(frequencies, np.hypot(a, b), np.arctan2(b, a), waves, series.values - coefficients @ columns)


def refined(series: Series, frequencies: Array) -> Array:
    """(K,) the frequencies for which the joint fit leaves least, from values that are nearly right."""
    if len(frequencies) == 0:
        return frequencies
    resolution = 1.0 / series.span
    result, best, step = frequencies, np.inf, np.zeros(len(frequencies))
    candidate: Array = frequencies
    for _ in range(_STEPS):
        fit = joint(series, candidate)
        left = float(fit.residual**2 @ series.shares)
        if left < best:
            result, best = candidate, left
            step = np.clip(_step(series, fit), -0.25 * resolution, 0.25 * resolution, dtype=np.float64)
        else:
            step = 0.5 * step
        if np.abs(step).max() < _CONVERGED * resolution:
            break
        candidate = np.maximum(result + step, 1e-3 * resolution)
    return result


def _step(series: Series, fit: Fit) -> Array:
    """(K,) the Gauss-Newton step of the frequencies, amplitudes and phases being free as well."""
    root = np.sqrt(series.shares)
    turns = 2.0 * np.pi * np.outer(fit.frequencies, series.hours)
    slopes = -2.0 * np.pi * series.hours * fit.amplitudes[:, None] * np.sin(turns - fit.phases[:, None])
    columns = np.concatenate([slopes, baseline(series), np.cos(turns), np.sin(turns)])
    return _solve(columns * root, fit.residual * root, 0.0)[: len(fit.frequencies)]


def _solve(columns: Array, values: Array, ridge: float, spare: int = 0) -> Array:
    """Least squares (C,) for columns (C, N); the first ``spare`` are not regularised."""
    gram = columns @ columns.T
    penalty = np.full(len(columns), ridge)
    penalty[:spare] = 0.0
    scale = np.maximum(np.diag(gram), np.finfo(np.float64).tiny)
    gram[np.diag_indices_from(gram)] += penalty + 1e-12 * scale
    return np.asarray(np.linalg.solve(gram, columns @ values), dtype=np.float64)
