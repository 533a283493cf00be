"""Consensus: the rigid motion of three matched points on which the most others agree.

M. Fischler and R. Bolles, *Random sample consensus*, CACM 1981, with the score of MSAC (P. Torr and A. Zisserman, CVIU
2000); a sample's motion in closed form by K. Arun, T. Huang and S. Blostein, *Least-squares fitting of two 3-D point
sets*, PAMI 1987. Inliers are judged by the covariance of their own error.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from common import geometry
from common.compiled import kernel
from services.estimator.lidar import model
from services.estimator.solving import small

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

_BATCH = 32
"""Samples drawn at a time: their closed forms are solved together."""


@kernel
def count_inliers(points: Array, live: Array, informations: Array, T: Array, gate2: float, inliers: Mask) -> float:
    """Mark the inliers; returns their truncated sum of squares as a score, larger is better (MSAC)."""
    moved, predicted, error = np.zeros(3), np.zeros(3), np.zeros(3)
    score = 0.0
    for i in range(points.shape[0]):
        inliers[i] = False
        if informations[i, 0, 0] > 0.0 and model.predict(points[i], T, moved, predicted):
            model.difference(live[i], predicted, error)
            error2 = small.quadratic3(error, informations[i])
            if error2 < gate2:
                inliers[i] = True
                score += 1.0 - error2 / gate2
    return score


def rigid(a: Array, b: Array) -> Array:
    """Transforms (K, 4, 4) that take points ``a`` (K, n, 3) to ``b`` (K, n, 3) with the least squares of distances."""
    centre_a, centre_b = a.mean(axis=1, keepdims=True), b.mean(axis=1, keepdims=True)
    u, _, vt = np.linalg.svd((b - centre_b).transpose(0, 2, 1) @ (a - centre_a))
    u[:, :, 2] *= np.linalg.det(u @ vt)[:, None]
    rotation = u @ vt
    return geometry.transform(rotation, (centre_b - centre_a @ rotation.transpose(0, 2, 1))[:, 0])


def consensus(
    points: Array,
    live: Array,
    informations: Array,
    start: Array,
    polish: Callable[[Array, Mask], Array],
    iterations: int,
    gate2: float,
) -> tuple[Array, Mask]:
    """The motion (4, 4) that most agree on, and its inliers (N,).

    ``points`` (N, 3) are the map's, ``live`` (N, 3) their measurements, ``informations`` (N, 3, 3) the inverse
    covariances of the errors of prediction. ``start``, the prior's motion, is the first candidate. ``polish`` fits a
    motion to the inliers of one that was better than all before, for three noisy points rarely tell it well (O. Chum,
    J. Matas and J. Kittler, *Locally optimized RANSAC*, DAGM 2003).
    """
    n = len(points)
    best_T, best_inliers, inliers = start, np.zeros(n, dtype=np.bool_), np.zeros(n, dtype=np.bool_)
    best_score = count_inliers(points, live, informations, start, gate2, best_inliers)
    # Seeded, so that the same scans give the same motion in every process.
    rng = np.random.default_rng(1)
    live_points = model.to_points(live)
    needed, done = float(iterations), 0
    while done < needed:
        sample = rng.integers(0, n, (_BATCH, 3))
        done += _BATCH
        distinct = (sample[:, 0] != sample[:, 1]) & (sample[:, 0] != sample[:, 2]) & (sample[:, 1] != sample[:, 2])
        sample = sample[distinct]
        for T in rigid(points[sample], live_points[sample]):
            score = count_inliers(points, live, informations, T, gate2, inliers)
            if score > best_score:
                best_score, best_T = score, T
                best_inliers[:] = inliers
                polished = polish(T, inliers)
                score = count_inliers(points, live, informations, polished, gate2, inliers)
                if score > best_score:
                    best_score, best_T = score, polished
                    best_inliers[:] = inliers
        # Samples until one without outliers has been drawn with probability 0.999.
        clean = float(best_inliers.mean()) ** 3
        needed = min(float(iterations), -6.9 / np.log1p(-min(clean, 0.999)) if clean > 0.0 else np.inf)
    return best_T, best_inliers
