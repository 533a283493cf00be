"""How fast an environment changes for good: the rate a of (3.2)."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from services.fleet.series import Matrix, Pairs, centred, evenly

Array = NDArray[np.float64]

_RATES = 60
_EVIDENCE = 3.0
"""Log-likelihood by which a trend has to explain more than none: its rate is one parameter, and one-sided."""


def rate(pairs: Pairs, alike: Matrix, waves: Callable[[Matrix], Matrix], swing: float) -> float:
    """a, 1/hour, of maps with a likeness (n, n), less its waves at each lag; 0 if it has no trend.

    In (3.3) both costs go from 0 to 1. So the trend is fitted in the waves' own measure: likeness falls by
    ``swing (1 - exp(-a |lag|))``, where ``swing`` is the difference of likeness that the cyclic cost calls 1. Without
    waves (``swing`` 0) its depth is free. The likeness has no means of rows and columns, and they are taken off the
    trend as well. Evidence counts maps, which are independent, not pairs.
    """
    hours = pairs.hours
    chosen = evenly(len(hours))
    some = np.ix_(chosen, chosen)
    lags, mask = pairs.lags[some], pairs.mask[some]
    left, ages = centred(alike[some] - waves(lags), mask), np.abs(lags)
    none = float((left**2).sum())
    best_rate, best = 0.0, none
    for candidate in np.geomspace(1e-2, 1e2, _RATES) / float(np.ptp(hours)):
        kept = centred(np.exp(-candidate * ages), mask)
        depth = swing or max(0.0, float((left * kept).sum() / max(float((kept**2).sum()), np.finfo(np.float64).tiny)))
        remainder = float(((left - depth * kept) ** 2).sum())
        if remainder < best:
            best_rate, best = float(candidate), remainder
    return best_rate if best > 0.0 and 0.5 * len(hours) * np.log(none / best) > _EVIDENCE else 0.0
