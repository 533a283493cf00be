"""Consensus: the pose of three landmarks on which the most others agree.

M. Fischler and R. Bolles, *Random sample consensus*, CACM 1981, with the score of MSAC (P. Torr and A. Zisserman, CVIU
2000). A sample's pose comes from Gauss-Newton on its nine measurements, which, unlike a closed form from one image,
weighs the disparities by their noise; inliers are judged by the covariance of their own error, so that a far landmark
is not refused for a depth that nobody measured well.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from common.compiled import kernel
from services.estimator.solving import normal_equations, small
from services.estimator.stereo import model

Array = NDArray[np.float64]


@kernel
def count_inliers(
    uvd: Array, live: Array, informations: Array, T: Array, k: Array, gate2: float, inliers: NDArray[np.bool_]
) -> float:
    """Mark the inliers; returns their truncated sum of squares as a score, larger is better (MSAC)."""
    predicted = np.zeros(3)
    score = 0.0
    for i in range(uvd.shape[0]):
        inliers[i] = False
        if informations[i, 0, 0] > 0.0 and model.predict(uvd[i], T, k, predicted) > 0.0:
            predicted -= live[i]
            error2 = small.quadratic3(predicted, informations[i])
            if error2 < gate2:
                inliers[i] = True
                score += 1.0 - error2 / gate2
    return score


@kernel
def _minimal(
    sample: NDArray[np.int64], uvd: Array, live: Array, informations: Array, start: Array, k: Array
) -> tuple[Array, bool]:
    """Pose of three landmarks by Gauss-Newton from ``start``; False where it does not converge."""
    T = start
    predicted, step = np.zeros(3), np.zeros(6)
    by_pose, by_landmark = np.zeros((3, 6)), np.zeros((3, 3))
    hessian, gradient = np.zeros((6, 6)), np.zeros(6)
    for _ in range(8):
        hessian[:] = 0.0
        gradient[:] = 0.0
        for a in range(6):
            hessian[a, a] = 1e-6
        for i in sample:
            if model.predict(uvd[i], T, k, predicted) <= 0.0:
                return T, False
            model.derivatives(uvd[i], T, k, by_pose, by_landmark)
            for j in range(3):
                predicted[j] = live[i, j] - predicted[j]
            normal_equations.accumulate(by_pose, informations[i], predicted, 1.0, hessian, gradient)
        if not normal_equations.cholesky_solve(hessian, gradient, step):
            return T, False
        size = np.abs(step).max()
        if not size < 10.0:
            return T, False
        T = small.perturb(T, step)
        if size < 1e-3:
            return T, True
    return T, False


@kernel
def consensus(
    uvd: Array, live: Array, informations: Array, start: Array, k: Array, iterations: int, gate2: float
) -> tuple[Array, NDArray[np.bool_], float]:
    """The pose with the best score over samples of three, its inliers (N,) and its score.

    ``informations`` (N, 3, 3) are of :func:`count_inliers`, ``start`` is where each sample's iterations begin.
    """
    n = uvd.shape[0]
    best_inliers, inliers = np.zeros(n, np.bool_), np.zeros(n, np.bool_)
    best_T = start.copy()
    best_score = count_inliers(uvd, live, informations, start, k, gate2, best_inliers)
    sample = np.zeros(3, np.int64)
    state = np.uint64(88172645463325252)
    needed, done = iterations, 0
    while done < needed:
        done += 1
        # Xorshift (Marsaglia): repeatable, and the same in every process.
        for j in range(3):
            state ^= state << np.uint64(13)
            state ^= state >> np.uint64(7)
            state ^= state << np.uint64(17)
            sample[j] = np.int64((state >> np.uint64(11)) % np.uint64(n))
        if sample[0] == sample[1] or sample[0] == sample[2] or sample[1] == sample[2]:
            continue
        T, converged = _minimal(sample, uvd, live, informations, start, k)
        if not converged:
            continue
        score = count_inliers(uvd, live, informations, T, k, gate2, inliers)
        if score > best_score:
            best_score, best_T = score, T
            best_inliers[:] = inliers
            ratio = inliers.sum() / n
            # Samples until one without outliers has been drawn with probability 0.999.
            if ratio < 1.0:
                needed = min(iterations, int(np.ceil(-6.9 / np.log(1.0 - ratio**3 + 1e-12))) + 5)
            else:
                needed = min(iterations, done + 5)
    return best_T, best_inliers, best_score
