"""Covariance of a robust solution, from the errors that were left over.

The inverse of the normal equations is the covariance only where the noise is as assumed and every measurement is
independent. Neither holds: patches that overlap are measured on the same pixels, those of one surface are seen through
the same error of its shape, and errors differ from place to place.
The estimator's own theory tells what its covariance is whatever the noise (P. Huber, *Robust statistics*, section 6.3,
the "sandwich" ``A^-1 B A^-1``), with measurements that depend on their neighbours (T. Conley, *GMM estimation with
cross sectional dependence*, J. Econometrics 1999): ``B = sum_ij k_ij s_i s_j^T`` over the scores ``s = w J^T W e``,
with weights ``k`` that fall linearly with the distance along each axis (Bartlett's, so that B is a covariance).
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from common.compiled import kernel

Array = NDArray[np.float64]

REACH = 51.0
"""Distance along either axis at which errors are taken as independent, pixels: those of one surface go together."""

_BORROWED = 30.0
"""Measurements that the assumption counts for beside the errors that are observed: few errors say little of their size.

What is assumed is the worst: that measurements within reach share their errors as far as the weights go."""


@kernel
def _score_covariance(scores: Array, places: Array, reach: float) -> Array:
    """``B`` (n, n) of scores (N, n) of measurements at places (N, 2), in no particular order, that reach ``reach``."""
    count, n = scores.shape
    out = np.zeros((n, n))
    order = np.argsort(places[:, 1])
    summed = np.zeros(n)
    for first in range(count):
        i = order[first]
        for a in range(n):
            summed[a] = 0.5 * scores[i, a]
        for second in range(first + 1, count):
            j = order[second]
            dv = places[j, 1] - places[i, 1]
            if dv >= reach:
                break
            du = abs(places[j, 0] - places[i, 0])
            if du < reach:
                overlap = (1.0 - du / reach) * (1.0 - dv / reach)
                for a in range(n):
                    summed[a] += overlap * scores[j, a]
        for a in range(n):
            for b in range(n):
                out[a, b] += scores[i, a] * summed[b] + summed[a] * scores[i, b]
    return out


def _company(places: Array, reach: float) -> float:
    """Mean number of measurements, of those at places (N, 2), whose errors one shares, itself included."""
    return float(_score_covariance(np.ones((len(places), 1)), places, reach)[0, 0] / max(len(places), 1))


@lru_cache
def weight_moments(robust_scale: float) -> tuple[float, float]:
    """``A`` and ``B`` of Geman-McClure's estimate for Gaussian errors, as parts of the normal equations' matrix.

    With weights w of errors e in 3 dimensions ``A = E[w + 2/3 w' e^2]`` and ``B = E[w^2 e^2]/3``; the normal equations
    have ``E[w]``.
    """
    e2 = np.linspace(0.0, 60.0, 6001)
    density = np.sqrt(e2) * np.exp(-0.5 * e2)
    density /= density.sum()
    k2 = robust_scale**2
    w, slope = (k2 / (k2 + e2)) ** 2, -2.0 * k2**2 / (k2 + e2) ** 3
    return (
        float(density @ (w + 2.0 / 3.0 * slope * e2) / (density @ w)),
        float(density @ (w * w * e2) / 3.0 / (density @ w)),
    )


def sandwich(
    hessian: Array, anchor: Array, scores: Array, places: Array, robust_scale: float, reach: float = REACH
) -> Array:
    """Covariance (n, n) of a Geman-McClure estimate of n unknowns.

    ``hessian`` (n, n) are the normal equations of the N measurements alone, ``anchor`` (n, n) the information of what
    was known before, ``scores`` (N, n) each measurement's part of the gradient at the solution, ``places`` (N, 2)
    where each was seen and ``reach`` the distance there at which errors are independent. Few measurements borrow from
    the noise that was assumed, so that independent errors are taken as somewhat larger than they are.
    """
    a, b = weight_moments(robust_scale)
    count = len(scores)
    assumed = b * _company(places, reach) * hessian
    spread = (count * _score_covariance(scores, places, reach) + _BORROWED * assumed) / (count + _BORROWED)
    inverse = np.linalg.inv(a * hessian + anchor + 1e-9 * np.eye(len(hessian)))
    covariance = inverse @ (spread + anchor) @ inverse.T
    return np.asarray(0.5 * (covariance + covariance.T))
