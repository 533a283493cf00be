"""Pose from stereo measurements: consensus of minimal samples, then robust Gauss-Newton.

Both frames measure: a landmark's own error counts as much as the live measurement's. The landmark is therefore an
unknown as well, ``(u, v, d)`` in the map's frame; it is eliminated in closed form, which leaves a 3 x 3 innovation per
landmark and six unknowns. Treating stored landmarks as exact instead would let far ones, of which disparity says
little, stretch the motion.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from common import geometry
from common.compiled import kernel
from common.geometry import Uncertain
from services.estimator.solving import normal_equations, small
from services.estimator.solving.covariance import sandwich
from services.estimator.stereo import model, ransac
from services.estimator.stereo.settings import MatchingSettings

Array = NDArray[np.float64]

CHI2_3_MEDIAN = 2.366
"""Median of the chi-square distribution with 3 degrees of freedom."""


SCALE_RANGE = (0.25, 25.0)
"""Bounds of the estimated scale of the noise's variance, against the settings."""

_NONE = 1e-10 * np.eye(2)
"""Covariance of a rectification that is taken as perfect."""


class Solution(NamedTuple):
    """A pose from measurements.

    Attributes:
        T_live_map: with the covariance of its left perturbation.
        inliers: (K,) bool, which measurements agree with it.
        rms: root mean square of the inliers' place errors in the live left image, pixels.
        rectification: (2,) estimated change of the disparity's error, pixels.
        rectification_covariance: (2, 2) of it.
    """

    T_live_map: Uncertain
    inliers: NDArray[np.bool_]
    rms: float
    rectification: Array
    rectification_covariance: Array


@kernel
def _by_rectification(m: Array, seen: Array, by_landmark: Array, k: Array, out: Array) -> None:
    """Write the derivative (3, 2) of the prediction less the measurement by the disparity's error ``[c0, c1]``.

    ``m`` and ``seen`` are the landmark and its measurement: the error enters both disparities.
    """
    before, after = (m[0] - k[2]) / k[0], (seen[0] - k[2]) / k[0]
    for i in range(3):
        out[i, 0], out[i, 1] = -by_landmark[i, 2], -by_landmark[i, 2] * before * before
    out[2, 0] += 1.0
    out[2, 1] += after * after


@kernel
def _informations(
    uvd: Array, covariances: Array, live: Array, noise: Array, T: Array, k: Array, rectification: Array
) -> Array:
    """Inverse covariances (N, 3, 3) of the errors of prediction at ``T``; zero behind the camera."""
    n = uvd.shape[0]
    out = np.zeros((n, 3, 3))
    by_pose, by_landmark, s, predicted = np.zeros((3, 6)), np.zeros((3, 3)), np.zeros((3, 3)), np.zeros(3)
    shared = np.zeros((3, 2))
    for i in range(n):
        if model.predict(uvd[i], T, k, predicted) > 0.0:
            model.derivatives(uvd[i], T, k, by_pose, by_landmark)
            small.innovation_covariance(by_landmark, covariances[i], noise[i], s)
            _by_rectification(uvd[i], live[i], by_landmark, k, shared)
            small.add_quadratic(shared, rectification, s)
            small.invert3(s, out[i])
    return out


@kernel
def _move_latent(latent: Array, shift: Array, covariance: Array, by_landmark: Array, weighted: Array) -> None:
    """Move a landmark (3,) to its optimum: back to its own measurement, and on by its share of the innovation."""
    for j in range(3):
        for p in range(3):
            shift[j] += covariance[j, p] * (
                by_landmark[0, p] * weighted[0] + by_landmark[1, p] * weighted[1] + by_landmark[2, p] * weighted[2]
            )
    for j in range(3):
        latent[j] += shift[j]


@kernel
def _linearize(
    uvd: Array,
    covariances: Array,
    live: Array,
    noise: Array,
    T: Array,
    c: Array,
    k: Array,
    latent: Array,
    robust2: float,
    hessian: Array,
    gradient: Array,
    errors2: Array,
    scores: Array,
) -> None:
    """Normal equations of pose and rectification with the landmarks eliminated; moves the landmarks to their optimum.

    With ``r1 = m - latent`` and ``r2 = live - h(T, latent)`` the innovation ``y = r2 - G r1`` has the covariance
    ``S = R2 + G R1 G^T``, whatever the landmark's true place; its weight is Geman-McClure's. ``scores`` (N, 8) are the
    measurements' parts of the gradient.
    """
    predicted, y, s, information = np.zeros(3), np.zeros(3), np.zeros((3, 3)), np.zeros((3, 3))
    r1, weighted, jacobian, shared = np.zeros(3), np.zeros(3), np.zeros((3, 8)), np.zeros((3, 2))
    by_pose, by_landmark = np.zeros((3, 6)), np.zeros((3, 3))
    hessian[:] = 0.0
    gradient[:] = 0.0
    for i in range(uvd.shape[0]):
        errors2[i] = np.inf
        scores[i] = 0.0
        if model.predict(latent[i], T, k, predicted) <= 0.0:
            continue
        model.derivatives(latent[i], T, k, by_pose, by_landmark)
        small.innovation_covariance(by_landmark, covariances[i], noise[i], s)
        if not small.invert3(s, information):
            continue
        _by_rectification(uvd[i], live[i], by_landmark, k, shared)
        before, after = (uvd[i, 0] - k[2]) / k[0], (live[i, 0] - k[2]) / k[0]
        for j in range(3):
            r1[j] = uvd[i, j] - latent[i, j]
            jacobian[j, :6] = by_pose[j]
            jacobian[j, 6:] = shared[j]
        r1[2] -= c[0] + c[1] * before * before
        for j in range(3):
            y[j] = live[i, j] - predicted[j]
            for p in range(3):
                y[j] -= by_landmark[j, p] * r1[p]
        y[2] -= c[0] + c[1] * after * after
        errors2[i] = small.quadratic3(y, information)
        weight = (robust2 / (robust2 + errors2[i])) ** 2
        normal_equations.accumulate(jacobian, information, y, weight, hessian, gradient)
        for j in range(3):
            weighted[j] = information[j, 0] * y[0] + information[j, 1] * y[1] + information[j, 2] * y[2]
        for a in range(8):
            for j in range(3):
                scores[i, a] += weight * jacobian[j, a] * weighted[j]
        _move_latent(latent[i], r1, covariances[i], by_landmark, weighted)


@kernel
def _refine(
    uvd: Array,
    covariances: Array,
    live: Array,
    noise: Array,
    start: Array,
    k: Array,
    anchor: Array,
    anchor_information: Array,
    iterations: int,
    robust2: float,
) -> tuple[Array, Array, Array, Array, Array]:
    """Robust Gauss-Newton over pose and rectification.

    ``anchor`` (8,) is the prior's value less the start, ``anchor_information`` (8, 8) its information. Returns the
    pose, the rectification's change (2,), the normal equations' matrix (8, 8), the squared errors (N,) and the scores
    (N, 8).
    """
    T, c = start.copy(), np.zeros(2)
    latent, errors2, scores = uvd.copy(), np.zeros(uvd.shape[0]), np.zeros((uvd.shape[0], 8))
    hessian, gradient, step = np.zeros((8, 8)), np.zeros(8), np.zeros(8)
    remaining = anchor.copy()
    for iteration in range(iterations + 1):
        _linearize(uvd, covariances, live, noise, T, c, k, latent, robust2, hessian, gradient, errors2, scores)
        hessian += anchor_information
        gradient += anchor_information @ remaining
        if iteration == iterations:
            break
        factor = hessian.copy()
        for a in range(8):
            factor[a, a] += 1e-9 * (1.0 + hessian[a, a])
        if not normal_equations.cholesky_solve(factor, gradient, step) or not np.abs(step).max() < 10.0:
            break
        T = small.perturb(T, step[:6].copy())
        c += step[6:]
        remaining -= step
        if np.abs(step).max() < 1e-6:
            break
    for a in range(8):
        for b in range(a):
            hessian[a, b] = hessian[b, a]
    return T, c, hessian, errors2, scores


def solve(
    landmarks: tuple[Array, Array],
    measured: tuple[Array, Array],
    start: Array,
    k: Array,
    settings: MatchingSettings,
    prior: Uncertain | None = None,
    rectification: Array | None = None,
) -> Solution | None:
    """Pose ``T_live_map`` of matched landmarks; None where no consensus of three is found.

    ``landmarks`` are measurements (N, 3) ``(u, v, d)`` in the map's frame with covariances (N, 3, 3), pixels;
    ``measured`` those of the live frame with covariances (N, 3, 3). ``start`` is where the samples' iterations
    begin, ``k`` the camera of :func:`model.intrinsics`. A ``prior`` of the pose takes part in the solve as one more
    measurement. ``rectification`` (2, 2) is the covariance of what may remain of the disparity's error in both frames,
    which is then estimated as well; without it there is none.

    The noise's scale is estimated from the errors' median, so that gates and weights fit images that are worse than the
    settings say; the covariance is that of :func:`services.estimator.solving.covariance.sandwich`.
    """
    uvd, covariances = landmarks
    live, noise = measured
    if len(uvd) < 3:
        return None
    gate2 = settings.inlier_gate**2
    shared = rectification if rectification is not None else _NONE
    informations = _informations(uvd, covariances, live, noise, start, k, shared)
    T, inliers, _ = ransac.consensus(uvd, live, informations, start, k, settings.ransac_iterations, gate2)
    if inliers.sum() < 3:
        return None
    anchor, information = np.zeros(8), np.zeros((8, 8))
    information[6:, 6:] = np.linalg.inv(shared + _NONE)
    scale = 1.0
    for _ in range(2):
        used = inliers
        subset = uvd[inliers], covariances[inliers] * scale, live[inliers], noise[inliers] * scale
        if prior is not None:
            anchor[:6] = geometry.log(prior.T @ geometry.inverse(T))
            information[:6, :6] = np.linalg.inv(prior.covariance + 1e-12 * np.eye(6))
        T, c, hessian, errors2, scores = _refine(
            *subset, T, k, anchor, information, settings.solver_iterations, settings.robust_scale**2
        )
        scale *= float(np.clip(np.median(errors2) / CHI2_3_MEDIAN, *SCALE_RANGE))
        informations = _informations(uvd, covariances * scale, live, noise * scale, T, k, _covariance(hessian)[6:, 6:])
        inliers = np.zeros(len(uvd), dtype=np.bool_)
        ransac.count_inliers(uvd, live, informations, T, k, gate2, inliers)
        if inliers.sum() < 3:
            return None
    covariance = sandwich(hessian - information, information, scores, live[used, :2], settings.robust_scale)
    return _summary(uvd, live, inliers, T, c, k, covariance)


def _covariance(hessian: Array) -> Array:
    covariance = np.linalg.inv(hessian + 1e-9 * np.eye(len(hessian)))
    return np.asarray(0.5 * (covariance + covariance.T))


def _summary(
    uvd: Array, live: Array, inliers: NDArray[np.bool_], T: Array, c: Array, k: Array, covariance: Array
) -> Solution:
    predicted = np.zeros((len(uvd), 3))
    for i in np.flatnonzero(inliers):
        model.predict(uvd[i], T, k, predicted[i])
    rms = float(np.sqrt(np.mean(np.sum((predicted - live)[inliers, :2] ** 2, axis=1))))
    return Solution(Uncertain(geometry.normalize(T), covariance[:6, :6]), inliers, rms, c, covariance[6:, 6:])
