"""How likely noise alone makes a peak: false-alarm probabilities, and noise that is not white."""

from __future__ import annotations

import itertools
import math

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_PER_BIN = 8
"""Independent frequencies that a piece of the noise's background has at least."""
_STEEPEST = -2.0
"""Slope of the background, in logarithms, below its first piece: a random walk's."""


def probability(power: float, samples: float, deviation: float, highest: float) -> float:
    """Probability that white noise has a peak of that power or more below frequency ``highest``, 1/hour.

    Baluev (*MNRAS* 385, 2008): an upper bound, sharp where it is small. ``samples`` is the number of them less what was
    fitted before, ``deviation`` the standard deviation of their times, hours.
    """
    free = samples - 3.0
    if free <= 1.0:
        return 1.0
    if power >= 1.0:
        return 0.0
    turns = highest * deviation * math.sqrt(4.0 * math.pi)
    gamma = math.sqrt(2.0 / (free + 2.0)) * math.exp(math.lgamma(0.5 * (free + 2.0)) - math.lgamma(0.5 * (free + 1.0)))
    left = math.log1p(-power)
    single = math.exp(0.5 * free * left)
    rate = gamma * turns * math.exp(0.5 * (free - 1.0) * left) * math.sqrt(0.5 * (free + 2.0) * power)
    return -math.expm1(math.log1p(-single) - rate) if single < 1.0 else 1.0


def level(wanted: float, samples: float, deviation: float, highest: float) -> float:
    """The power that white noise reaches with the wanted probability; the inverse of :func:`probability`."""
    low, high = 0.0, 1.0
    for _ in range(60):
        middle = 0.5 * (low + high)
        if probability(middle, samples, deviation, highest) > wanted:
            low = middle
        else:
            high = middle
    return high


def background(power: Array, frequencies: Array, samples: float, resolution: float) -> Array:
    """(M,) by how much the noise about each frequency exceeds white noise of the same variance; at least 1.

    Real series are restless over days whether or not they have a rhythm. The median power of pieces of the spectrum,
    which single peaks do not move, is joined by straight lines of logarithms. ``resolution`` is one over the span.
    """
    excess = power * 0.5 * (samples - 3.0)
    edges = [0]
    while edges[-1] < len(power):
        wide = max(_PER_BIN * resolution, 0.4 * frequencies[edges[-1]])
        edges.append(int(np.searchsorted(frequencies, frequencies[edges[-1]] + wide, side="right")))
    if len(edges) > 2 and frequencies[-1] - frequencies[edges[-2]] < _PER_BIN * resolution:
        edges.pop(-2)
    pieces = [slice(a, b) for a, b in itertools.pairwise(edges)]
    centres = np.log([frequencies[piece].mean() for piece in pieces])
    heights = np.log([max(float(np.median(excess[piece])) / math.log(2.0), 1e-12) for piece in pieces])
    at = np.log(frequencies)
    height: Array = np.interp(at, centres, heights)
    if len(pieces) > 1:
        slope = np.clip((heights[1] - heights[0]) / (centres[1] - centres[0]), _STEEPEST, 0.0)
        height = np.where(at < centres[0], heights[0] + slope * (at - centres[0]), height)
    return np.maximum(np.exp(height), 1.0)
