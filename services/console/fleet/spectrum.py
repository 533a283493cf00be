"""The power of each period, thinned to what a picture can show."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from common.messages import EnvironmentSpectrum

Array = NDArray[np.float64]


def thinned(spectrum: EnvironmentSpectrum, most: int = 400) -> tuple[Array, Array]:
    """Periods (M,), hours, ascending, and their powers: the strongest of each of ``most`` bins, equal in the logarithm.

    So no peak is lost, however many frequencies were looked at.
    """
    order = np.argsort(-spectrum.frequencies, kind="stable")
    periods, power = 1.0 / spectrum.frequencies[order], spectrum.power[order]
    if len(periods) <= most:
        return periods, power
    edges = np.geomspace(periods[0], periods[-1], most + 1)
    bins = np.clip(np.searchsorted(edges, periods, side="right") - 1, 0, most - 1)
    ranked = np.lexsort((-power, bins))
    best = np.sort(ranked[np.r_[True, np.diff(bins[ranked]) > 0]])
    return periods[best], power[best]
