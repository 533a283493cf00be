"""How fast an environment changes for good: the rate a of (3.2)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from services.fleet.series import Series

Array = NDArray[np.float64]

_RATES = 120
_EVIDENCE = 3.0
"""Log-likelihood by which a trend has to explain more than none: its rate is one parameter, and one-sided."""


def rate(series: Series, without_waves: Array, swing: float, samples: int) -> float:
    """a, 1/hour, from what a series over lags (N,) shows beside its waves; 0 where it shows no trend.

    In (3.3) both costs go from 0 to 1. So the trend is fitted in the waves' own measure: likeness falls by
    ``swing (1 - exp(-a |lag|))``, where ``swing`` is the difference of likeness that the cyclic cost calls 1. Without
    waves (``swing`` 0) its depth is free. ``samples`` is the number of maps, which are independent, unlike their pairs.
    """
    shares, ages = series.shares, np.abs(series.hours)
    centred = without_waves - without_waves @ shares
    none = float(centred**2 @ shares)
    best_rate, best = 0.0, none
    for candidate in np.geomspace(1e-3 / series.span, 30.0 / series.span, _RATES):
        kept = np.exp(-candidate * ages)
        kept = kept - kept @ shares
        depth = swing or max(0.0, float(centred @ (kept * shares)) / max(float(kept**2 @ shares), 1e-300))
        left = float((centred - depth * kept) ** 2 @ shares)
        if left < best:
            best_rate, best = float(candidate), left
    if best <= 0.0 or 0.5 * samples * np.log(none / best) < _EVIDENCE:
        return 0.0
    return best_rate
