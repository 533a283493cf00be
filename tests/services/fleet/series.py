"""Series whose rhythms are known."""

import numpy as np


def mixture(rng, count, days, periods, noise, amplitudes=None):
    """Irregular times (N,), hours; values; and the phases of the rhythms in them, at time 0."""
    hours = np.sort(rng.uniform(0, 24 * days, count))
    phases = rng.uniform(-np.pi, np.pi, len(periods))
    amplitudes = np.ones(len(periods)) if amplitudes is None else amplitudes
    waves = [a * np.cos(2 * np.pi * hours / T - p) for a, T, p in zip(amplitudes, periods, phases, strict=True)]
    return hours, sum(waves, np.zeros(count)) + noise * rng.normal(size=count), phases


def office_hours(rng, count, weeks):
    """Times within 8 to 18 h of weekdays."""
    hours = rng.uniform(0, 168 * weeks, 8 * count)
    return np.sort(hours[(hours % 24 >= 8) & (hours % 24 < 18) & (hours // 24 % 7 < 5)][:count])


def likeness_of(rng, hours, periods, noise, rate=0.0):
    """A symmetric matrix of likelihoods of maps that look like each other a whole number of periods apart."""
    lags = hours[:, None] - hours
    alike = sum((np.cos(2 * np.pi * lags / T) for T in periods), np.zeros_like(lags)) + 2 * np.exp(-rate * np.abs(lags))
    alike = alike + noise * rng.normal(size=lags.shape)
    return 200.0 + 10.0 * (alike + alike.T)
