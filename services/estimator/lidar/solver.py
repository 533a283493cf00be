"""Pose from matched keypoints: consensus of minimal samples, then robust Gauss-Newton on the spherical errors.

Bundle adjustment of two scans: both measure. A landmark's own error counts as much as the live measurement's, so the
landmark is an unknown as well; it is eliminated in closed form, which leaves a 3 x 3 innovation per landmark,
``S = R + G P G^T``, and six unknowns.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from common import geometry
from common.compiled import kernel
from common.geometry import Uncertain
from services.estimator.lidar import model, ransac
from services.estimator.lidar.features import Landmarks, LidarFeatures
from services.estimator.lidar.matching import Matches
from services.estimator.lidar.settings import MatchingSettings
from services.estimator.solving import normal_equations, small
from services.estimator.solving.covariance import sandwich

Array = NDArray[np.float64]

CHI2_3_MEDIAN = 2.366
"""Median of the chi-square distribution with 3 degrees of freedom."""
SCALE_RANGE = (0.1, 25.0)
"""Bounds of the estimated scale of the noise's variance, against the settings."""
_POLISHING = 3
"""Steps of Gauss-Newton from a sample's motion."""
_REACH = 0.1
"""Angle within which the errors of two keypoints are taken to have something in common, radians."""


class Solution(NamedTuple):
    """A pose from matches.

    Attributes:
        T_live_map: with the covariance of its left perturbation.
        inliers: (K,) bool, which matches agree with it.
        rms: root mean square of the inliers' distances, metres.
    """

    T_live_map: Uncertain
    inliers: NDArray[np.bool_]
    rms: float


@kernel
def _informations(points: Array, covariances: Array, noise: Array, T: Array) -> Array:
    """Inverse covariances (N, 3, 3) of the errors of prediction at ``T``."""
    n = points.shape[0]
    out = np.zeros((n, 3, 3))
    by_pose, by_landmark, s = np.zeros((3, 6)), np.zeros((3, 3)), np.zeros((3, 3))
    moved, predicted = np.zeros(3), np.zeros(3)
    for i in range(n):
        if model.predict(points[i], T, moved, predicted):
            model.derivatives(moved, T, by_pose, by_landmark)
            small.innovation_covariance(by_landmark, covariances[i], noise[i], s)
            small.invert3(s, out[i])
    return out


@kernel
def _linearize(
    points: Array, covariances: Array, live: Array, noise: Array, T: Array, robust2: float,
    hessian: Array, gradient: Array, errors2: Array, scores: Array,
) -> None:  # fmt: skip
    """Normal equations of the pose with the landmarks eliminated, weighted by Geman and McClure.

    ``errors2`` (N,) are the squared standardised errors, ``scores`` (N, 6) the measurements' parts of the gradient.
    """
    moved, predicted, y = np.zeros(3), np.zeros(3), np.zeros(3)
    s, information = np.zeros((3, 3)), np.zeros((3, 3))
    by_pose, by_landmark = np.zeros((3, 6)), np.zeros((3, 3))
    hessian[:] = 0.0
    gradient[:] = 0.0
    for i in range(points.shape[0]):
        errors2[i] = np.inf
        scores[i] = 0.0
        if not model.predict(points[i], T, moved, predicted):
            continue
        model.derivatives(moved, T, by_pose, by_landmark)
        small.innovation_covariance(by_landmark, covariances[i], noise[i], s)
        if not small.invert3(s, information):
            continue
        model.difference(live[i], predicted, y)
        errors2[i] = small.quadratic3(y, information)
        weight = (robust2 / (robust2 + errors2[i])) ** 2
        normal_equations.accumulate(by_pose, information, y, weight, hessian, gradient)
        for a in range(6):
            for j in range(3):
                scores[i, a] += (
                    weight
                    * by_pose[j, a]
                    * (information[j, 0] * y[0] + information[j, 1] * y[1] + information[j, 2] * y[2])
                )


@kernel
def _refine(
    points: Array, covariances: Array, live: Array, noise: Array, start: Array, anchor: Array,
    anchor_information: Array, iterations: int, robust2: float,
) -> tuple[Array, Array, Array, Array]:  # fmt: skip
    """Robust Gauss-Newton: the pose, the measurements' matrix (6, 6), squared errors (N,) and scores (N, 6).

    ``anchor`` (6,) is the prior's pose less the start, ``anchor_information`` (6, 6) its information.
    """
    T = start.copy()
    errors2, scores = np.zeros(points.shape[0]), np.zeros((points.shape[0], 6))
    hessian, gradient, step = np.zeros((6, 6)), np.zeros(6), np.zeros(6)
    remaining = anchor.copy()
    for iteration in range(iterations + 1):
        _linearize(points, covariances, live, noise, T, robust2, hessian, gradient, errors2, scores)
        if iteration == iterations:
            break
        factor = hessian + anchor_information
        gradient += anchor_information @ remaining
        for a in range(6):
            factor[a, a] += 1e-9 * (1.0 + factor[a, a])
        if not normal_equations.cholesky_solve(factor, gradient, step) or not np.abs(step).max() < 10.0:
            break
        T = small.perturb(T, step)
        remaining -= step
        if np.abs(step).max() < 1e-6:
            break
    for a in range(6):
        for b in range(a):
            hessian[a, b] = hessian[b, a]
    return T, hessian, errors2, scores


def solve(
    landmarks: tuple[Array, Array],
    measured: tuple[Array, Array],
    start: Array,
    settings: MatchingSettings,
    prior: Uncertain | None = None,
) -> Solution | None:
    """Pose ``T_live_map`` of matched landmarks; None where no consensus of three is found.

    ``landmarks`` are points (N, 3) with covariances (N, 3, 3) in the map's frame, metres; ``measured`` the live
    measurements (N, 3) with theirs. ``start`` (4, 4) is the first candidate. A ``prior`` of the pose takes part as one
    more measurement. The noise's scale is estimated from the errors' median.
    """
    points, covariances = landmarks
    live, noise = measured
    if len(points) < 3:
        return None
    gate2 = settings.inlier_gate**2
    informations = _informations(points, covariances, noise, start)
    robust2 = settings.robust_scale**2

    def polish(T: Array, chosen: NDArray[np.bool_]) -> Array:
        subset = points[chosen], covariances[chosen], live[chosen], noise[chosen]
        return _refine(*subset, T, np.zeros(6), np.zeros((6, 6)), _POLISHING, robust2)[0]

    T, inliers = ransac.consensus(points, live, informations, start, polish, settings.ransac_iterations, gate2)
    if inliers.sum() < 3:
        return None
    anchor, information = np.zeros(6), np.zeros((6, 6))
    if prior is not None:
        information = np.asarray(np.linalg.inv(prior.covariance + 1e-12 * np.eye(6)))
    scale = 1.0
    for _ in range(3):
        used = inliers
        subset = points[used], covariances[used] * scale, live[used], noise[used] * scale
        if prior is not None:
            anchor = geometry.log(prior.T @ geometry.inverse(T))
        T, hessian, errors2, scores = _refine(*subset, T, anchor, information, settings.solver_iterations, robust2)
        scale = float(np.clip(scale * np.median(errors2) / CHI2_3_MEDIAN, *SCALE_RANGE))
        informations = _informations(points, covariances * scale, noise * scale, T)
        inliers = np.zeros(len(points), dtype=np.bool_)
        ransac.count_inliers(points, live, informations, T, gate2, inliers)
        if inliers.sum() < 3:
            return None
    spread = sandwich(hessian, information, scores, live[used, :2], settings.robust_scale, _REACH)
    errors = model.to_points(live[inliers]) - geometry.apply(T, points[inliers])
    rms = float(np.sqrt(np.mean(np.sum(errors**2, axis=1))))
    return Solution(Uncertain(geometry.normalize(T), spread), inliers, rms)


def solve_matches(
    landmarks: Landmarks,
    live: LidarFeatures,
    found: Matches,
    start: Array,
    settings: MatchingSettings,
    prior: Uncertain | None = None,
) -> Solution | None:
    """:func:`solve` for the landmarks of a map that were found among the features of a live scan."""
    chosen = landmarks.points[found.landmarks], landmarks.covariances[found.landmarks]
    points, covariances = (np.asarray(a, dtype=np.float64) for a in chosen)
    measured = live.measurements[found.features], live.covariances[found.features]
    return solve((points, covariances), measured, start, settings, prior)
