"""Bundle adjustment of a window of keyframes: all poses and all landmarks at once, from what every keyframe measured.

The measurement model is that of :mod:`model`: a landmark is ``(u, v, d)`` in the keyframe that saw it first, its
*anchor*, and every later keyframe measures ``(u, v, d)`` of it. Landmarks are eliminated by the Schur complement
(B. Triggs et al., *Bundle adjustment: a modern synthesis*, 2000, section 6), which leaves six unknowns a keyframe and
the two of the rectification that all measurements share; Levenberg and Marquardt damp the steps, Geman and McClure the
outliers. The oldest keyframe is held: nothing but motions between keyframes is measured, or handed on.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from common import geometry
from common.compiled import kernel
from common.geometry import Uncertain
from services.estimator.solving import normal_equations, small
from services.estimator.solving.covariance import sandwich, weight_moments
from services.estimator.stereo import model
from services.estimator.stereo.settings import BundleSettings
from services.estimator.stereo.solver import CHI2_3_MEDIAN, SCALE_RANGE

Array = NDArray[np.float64]

_RECTIFICATION = 2
"""Unknowns of the rectification, after those of the poses."""

_SMALL_GAIN = 1e-4
"""Part of the cost below which a step's gain ends the iterations."""

_NOTHING = 1e-12
"""A cost that is zero but for rounding."""


@dataclass(frozen=True, slots=True)
class Problem:
    """K keyframes, L landmarks and M measurements of them beside the anchors' own.

    Attributes:
        T_keyframes_first: (K, 4, 4), each keyframe's pose as the transform from the first's optical frame to its own.
        anchors: (L,) keyframe that saw each landmark first.
        uvd, covariances: (L, 3) and (L, 3, 3), its measurement there, pixels.
        landmarks, keyframes: (M,) which landmark was measured by which later keyframe, in the order of the landmarks.
        measured, noise: (M, 3) and (M, 3, 3), that measurement, pixels.
        rectification: (2, 2) covariance of what may remain of the disparity's error ``[c0, c1]``, pixels.
    """

    T_keyframes_first: Array
    anchors: NDArray[np.int64]
    uvd: Array
    covariances: Array
    landmarks: NDArray[np.int64]
    keyframes: NDArray[np.int64]
    measured: Array
    noise: Array
    rectification: Array


@dataclass(frozen=True, slots=True)
class Adjusted:
    """What the measurements of a window say together.

    Attributes:
        T_keyframes_first: (K, 4, 4) as in the problem.
        covariance: (6(K-1) + 2, 6(K-1) + 2) of the left perturbations of all poses but the first, and of the
            rectification.
        uvd: (L, 3) landmarks in their anchors.
        rectification: (2,) change of the disparity's error.
        errors2: (M,) squared standardised errors, of 3 degrees of freedom each.
        newest: (L, 3) landmarks as the newest keyframe measures them; not finite behind it.
        newest_covariances: (L, 3, 3) of them.
        iterations: steps taken.
    """

    T_keyframes_first: Array
    covariance: Array
    uvd: Array
    rectification: Array
    errors2: Array
    newest: Array
    newest_covariances: Array
    iterations: int

    def pose(self, keyframe: int) -> Uncertain:
        """``T_keyframe_first`` with its covariance; the first's is zero."""
        if keyframe == 0:
            return Uncertain.identity()
        block = slice(6 * (keyframe - 1), 6 * keyframe)
        return Uncertain(self.T_keyframes_first[keyframe], self.covariance[block, block])


class _Given(NamedTuple):
    """What stays as it is while a window is solved.

    Attributes:
        anchors: (L,) keyframe that saw each landmark first.
        stored, informations: (L, 3) and (L, 3, 3) its measurement there, and the inverse of its covariance.
        starts: (L + 1,) where each landmark's later measurements begin.
        keyframes, measured, noise_informations: (M,), (M, 3) and (M, 3, 3) of these.
        k: the camera.
        robust2: square of the error at which Geman-McClure's weight has fallen to a quarter.
    """

    anchors: NDArray[np.int64]
    stored: Array
    informations: Array
    starts: NDArray[np.int64]
    keyframes: NDArray[np.int64]
    measured: Array
    noise_informations: Array
    k: Array
    robust2: float


class _System(NamedTuple):
    """Normal equations of n unknowns with the landmarks eliminated, and what brings the landmarks back.

    Attributes:
        hessian, gradient: (n, n) and (n,) of poses and rectification.
        by_landmark: (L, n, 3) what couples them to the landmarks.
        inverses: (L, 3, 3) inverses of the landmarks' own blocks.
        pulls: (L, 3) the landmarks' own gradients.
        scores: (L, n) the landmarks' parts of ``gradient``.
        errors2: (M,) squared errors.
        cost: robust sum.
    """

    hessian: Array
    gradient: Array
    by_landmark: Array
    inverses: Array
    pulls: Array
    scores: Array
    errors2: Array
    cost: float


@kernel
def _relative(T_keyframes_first: Array, keyframe: int, anchor: int) -> Array:
    """``T_keyframe_anchor`` (4, 4)."""
    T = T_keyframes_first[anchor]
    inverse = np.eye(4)
    for a in range(3):
        for b in range(3):
            inverse[a, b] = T[b, a]
            inverse[a, 3] -= T[b, a] * T[b, 3]
    return np.ascontiguousarray(T_keyframes_first[keyframe]) @ inverse


@kernel
def _adjoint(T: Array) -> Array:
    """Adjoint (6, 6) of a transform, as :func:`common.geometry.adjoint`."""
    out = np.zeros((6, 6))
    t = T[:3, 3]
    cross = np.array([[0.0, -t[2], t[1]], [t[2], 0.0, -t[0]], [-t[1], t[0], 0.0]])
    R = np.ascontiguousarray(T[:3, :3])
    out[:3, :3] = out[3:, 3:] = R
    out[:3, 3:] = cross @ R
    return out


@kernel
def _curve(u: float, k: Array) -> float:
    x = (u - k[2]) / k[0]
    return float(x * x)


@kernel
def _jacobians(m: Array, T: Array, anchor: int, keyframe: int, k: Array, by_state: Array, by_landmark: Array) -> None:
    """Write the derivatives of the prediction by poses (3, n) and landmark (3, 3); the rectification's stay zero."""
    by_pose = np.zeros((3, 6))
    model.derivatives(m, T, k, by_pose, by_landmark)
    by_state[:] = 0.0
    if keyframe > 0:
        by_state[:, 6 * (keyframe - 1) : 6 * keyframe] = by_pose
    if anchor > 0:
        by_state[:, 6 * (anchor - 1) : 6 * anchor] = -(by_pose @ _adjoint(T))


@kernel
def _errors(T_keyframes_first: Array, c: Array, uvd: Array, given: _Given, errors2: Array) -> float:
    """Write the squared errors (M,), infinite behind a camera; returns the robust cost.

    A measurement's error has its share of the landmark's distance from the anchor's measurement, so that with one
    measurement the sum is the innovation's, as in the solve of a single pair.
    """
    cost = 0.0
    anchors, stored, informations, starts, keyframes, measured, noise_informations, k, robust2 = given
    r, predicted = np.zeros(3), np.zeros(3)
    for i in range(uvd.shape[0]):
        r[:] = stored[i] - uvd[i]
        r[2] -= c[0] + c[1] * _curve(stored[i, 0], k)
        share = small.quadratic3(r, informations[i]) / max(starts[i + 1] - starts[i], 1)
        for o in range(starts[i], starts[i + 1]):
            T = _relative(T_keyframes_first, keyframes[o], anchors[i])
            if model.predict(uvd[i], T, k, predicted) <= 0.0:
                errors2[o] = np.inf
                cost += robust2
                continue
            r[:] = measured[o] - predicted
            r[2] -= c[0] + c[1] * _curve(measured[o, 0], k)
            errors2[o] = share + small.quadratic3(r, noise_informations[o])
            cost += robust2 * errors2[o] / (robust2 + errors2[o])
    return cost


@kernel
def _linearize(T_keyframes_first: Array, c: Array, uvd: Array, given: _Given, damping: float) -> _System:
    """Normal equations at the present estimate, the landmarks eliminated with ``damping`` on their blocks."""
    anchors, stored, informations, starts, keyframes, measured, noise_informations, k, robust2 = given
    count, n = uvd.shape[0], 6 * (T_keyframes_first.shape[0] - 1) + 2
    hessian, gradient = np.zeros((n, n)), np.zeros(n)
    by_landmark, inverses = np.zeros((count, n, 3)), np.zeros((count, 3, 3))
    pulls, scores, errors2 = np.zeros((count, 3)), np.zeros((count, n)), np.zeros(measured.shape[0])
    cost = _errors(T_keyframes_first, c, uvd, given, errors2)
    state, own, r, predicted = np.zeros((3, n)), np.zeros((3, 3)), np.zeros(3), np.zeros(3)
    block, anchored = np.zeros((3, 3)), np.zeros((3, n))
    for i in range(count):
        weights, used = 0.0, 0
        block[:] = 0.0
        for o in range(starts[i], starts[i + 1]):
            if not np.isfinite(errors2[o]):
                continue
            weight = (robust2 / (robust2 + errors2[o])) ** 2
            weights, used = weights + weight, used + 1
            T = _relative(T_keyframes_first, keyframes[o], anchors[i])
            model.predict(uvd[i], T, k, predicted)
            _jacobians(uvd[i], T, anchors[i], keyframes[o], k, state, own)
            state[2, n - 2], state[2, n - 1] = 1.0, _curve(measured[o, 0], k)
            r[:] = measured[o] - predicted
            r[2] -= c[0] + c[1] * _curve(measured[o, 0], k)
            weighted = weight * noise_informations[o]
            hessian += state.T @ weighted @ state
            scores[i] += state.T @ (weighted @ r)
            block += own.T @ weighted @ own
            pulls[i] += own.T @ (weighted @ r)
            by_landmark[i] += state.T @ weighted @ own
        if used == 0:
            continue
        weighted = weights / used * informations[i]
        r[:] = stored[i] - uvd[i]
        r[2] -= c[0] + c[1] * _curve(stored[i, 0], k)
        anchored[2, n - 2], anchored[2, n - 1] = 1.0, _curve(stored[i, 0], k)
        hessian += anchored.T @ weighted @ anchored
        scores[i] += anchored.T @ (weighted @ r)
        block += weighted
        pulls[i] += weighted @ r
        by_landmark[i] += anchored.T @ weighted
        for a in range(3):
            block[a, a] *= 1.0 + damping
        if not small.invert3(block, inverses[i]):
            inverses[i] = 0.0
            continue
        carried = by_landmark[i] @ inverses[i]
        hessian -= carried @ by_landmark[i].T
        scores[i] -= carried @ pulls[i]
        gradient += scores[i]
    return _System(hessian, gradient, by_landmark, inverses, pulls, scores, errors2, cost)


@kernel
def _newest(
    T_keyframes_first: Array,
    uvd: Array,
    anchors: NDArray[np.int64],
    k: Array,
    system: _System,
    covariance: Array,
    spread: float,
) -> tuple[Array, Array]:
    """Landmarks (L, 3) as the newest keyframe measures them, with covariances (L, 3, 3), the poses' errors included.

    ``spread`` is what a robust estimate's covariance is of the inverse of its weighted normal equations.
    """
    count, n, last = uvd.shape[0], covariance.shape[0], T_keyframes_first.shape[0] - 1
    places, covariances = np.full((count, 3), np.nan), np.full((count, 3, 3), np.nan)
    state, own, predicted = np.zeros((3, n)), np.zeros((3, 3)), np.zeros(3)
    for i in range(count):
        T = _relative(T_keyframes_first, last, anchors[i])
        if model.predict(uvd[i], T, k, predicted) <= 0.0 or system.inverses[i, 0, 0] <= 0.0:
            continue
        _jacobians(uvd[i], T, anchors[i], last, k, state, own)
        carried = state - own @ system.inverses[i] @ system.by_landmark[i].T
        places[i] = predicted
        covariances[i] = spread * (own @ system.inverses[i] @ own.T) + carried @ covariance @ carried.T
    return places, covariances


def adjust(problem: Problem, k: Array, settings: BundleSettings) -> Adjusted | None:
    """Solve a window for the camera ``k`` of :func:`model.intrinsics`.

    None where there is nothing to solve: fewer than two keyframes, a keyframe that fewer than three landmarks tie to
    the others, or equations that determine no motion.
    """
    count = len(problem.T_keyframes_first)
    if count < 2 or len(problem.landmarks) == 0 or not _is_connected(problem, count):
        return None
    starts = np.searchsorted(problem.landmarks, np.arange(len(problem.uvd) + 1)).astype(np.int64)
    anchor = np.zeros((6 * (count - 1) + _RECTIFICATION,) * 2)
    anchor[-2:, -2:] = np.linalg.inv(problem.rectification + 1e-10 * np.eye(2))
    informations = np.asarray(np.linalg.inv(problem.covariances), dtype=np.float64)
    noise_informations = np.asarray(np.linalg.inv(problem.noise), dtype=np.float64)
    scale = 1.0
    T, c, uvd, steps = problem.T_keyframes_first.copy(), np.zeros(2), problem.uvd.copy(), 0
    for _ in range(2):
        # The noise's scale as the errors have it, so that weights fit images that are worse than the settings say.
        given = _Given(
            problem.anchors, problem.uvd, np.asarray(informations / scale), starts, problem.keyframes, problem.measured,
            np.asarray(noise_informations / scale), k, settings.robust_scale**2,
        )  # fmt: skip
        T, c, uvd, more, errors2 = _descend((T, c, uvd), given, anchor[-2:, -2:], settings.iterations)
        if more < 0:
            return None
        steps += more
        scale *= float(np.clip(np.median(errors2) / CHI2_3_MEDIAN, *SCALE_RANGE))
    system = _linearize(T, c, uvd, given, 0.0)
    # A landmark's last measurement says which others share its errors.
    seen = starts[1:] > starts[:-1]
    places = problem.measured[starts[1:][seen] - 1, :2]
    try:
        covariance = sandwich(system.hessian, anchor, system.scores[seen], places, settings.robust_scale)
    except np.linalg.LinAlgError:
        return None
    # A landmark has too few measurements for their errors to tell: its part is that of the errors which are expected.
    slope, spread = weight_moments(settings.robust_scale)
    newest, newest_covariances = _newest(T, uvd, problem.anchors, k, system, covariance, spread / slope**2)
    return Adjusted(geometry.normalize(T), covariance, uvd, c, system.errors2, newest, newest_covariances, steps)


def _is_connected(problem: Problem, count: int) -> bool:
    """Whether at least three measurements hold every keyframe but the first."""
    return bool((np.bincount(problem.keyframes, minlength=count)[1:] >= 3).all())


def _descend(
    start: tuple[Array, Array, Array], given: _Given, anchor: Array, iterations: int
) -> tuple[Array, Array, Array, int, Array]:
    """Levenberg-Marquardt: poses, rectification, landmarks, steps (-1: no solution) and squared errors (M,)."""
    T, c, uvd = start
    damping, steps = 1e-4, 0
    system = _linearize(T, c, uvd, given, damping)
    for _ in range(iterations):
        hessian, gradient = system.hessian.copy(), system.gradient.copy()
        hessian[-2:, -2:] += anchor
        gradient[-2:] -= anchor @ c
        diagonal = np.arange(len(hessian))
        hessian[diagonal, diagonal] += damping * hessian[diagonal, diagonal] + 1e-9
        step = np.zeros(len(gradient))
        if not (normal_equations.cholesky_solve(hessian, gradient, step) and np.abs(step).max() < 10.0):
            return T, c, uvd, -1, system.errors2
        moved = np.array([geometry.exp(x) @ P for x, P in zip(step[:-2].reshape(-1, 6), T[1:], strict=True)])
        T_new, c_new = np.concatenate([T[:1], moved]), c + step[-2:]
        change = system.pulls - np.einsum("lnj,n->lj", system.by_landmark, step)
        uvd_new = uvd + np.einsum("lij,lj->li", system.inverses, change)
        before = system.cost + c @ anchor @ c
        cost = _errors(T_new, c_new, uvd_new, given, np.zeros_like(system.errors2)) + c_new @ anchor @ c_new
        better = cost <= before + _NOTHING
        if better:
            T, c, uvd, steps = T_new, c_new, uvd_new, steps + 1
        if abs(before - cost) <= _SMALL_GAIN * before + _NOTHING:
            break
        damping = damping * (0.1 if better else 10.0)
        system = _linearize(T, c, uvd, given, damping)
    return T, c, uvd, steps, system.errors2
