"""Joint refinement: both lenses, the transform between them and every pose of the board, from all corners at once.

Least squares on the reprojection errors of both images by Levenberg-Marquardt, first robust (Geman-McClure, by
iteratively reweighting), then plain on what is left, so that the inverse of the normal equations is the covariance.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from services.sensors.calibration.errors import CalibrationError
from services.sensors.calibration.rig import Lens, StereoRig
from services.sensors.calibration.views import View

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

_ITERATIONS = 60
_CONVERGED = 1e-10
"""Relative change of the cost."""
_MAD_TO_SIGMA = 1.4826
_POLYNOMIAL = 5
_PRIOR = 0.01
"""Weight of the rational model's denominator being 1, as of errors of 0.1 px beside coefficients of 1.

Where a lens needs none, numerator and denominator would grow together without bound.
"""


@dataclass(frozen=True, slots=True)
class Problem:
    """The measurements: views, and the board's corners (N, 3), metres. ``used`` (V, 2, N) tells which are believed."""

    views: Sequence[View]
    objects: Array
    used: Mask

    @classmethod
    def of(cls, views: Sequence[View], objects: Array) -> Problem:
        """All corners that are seen."""
        used = np.zeros((len(views), 2, len(objects)), dtype=np.bool_)
        for row, view in zip(used, views, strict=True):
            row[0, view.left.ids] = row[1, view.right.ids] = True
        return cls(views, objects, used)


@dataclass(frozen=True, slots=True)
class Solution:
    """What fits the measurements best.

    Attributes:
        rig: both cameras.
        poses: (V, 6) of the board in the left camera, rotation vector and translation.
        residuals: (V, 2, N, 2) measured minus projected, pixels; NaN where a corner was not seen.
        covariance: of ``[left lens, right lens, rotation vector, T]``; a lens is fx, fy, cx, cy and its distortion.
    """

    rig: StereoRig
    poses: Array
    residuals: Array
    covariance: Array

    def rms(self, used: Mask) -> float:
        """Root mean square of the believed corners' distances from their projections, pixels."""
        return float(np.sqrt((self.residuals[used] ** 2).sum(axis=-1).mean()))


def solve(problem: Problem, rig: StereoRig, poses: Array, robust_px: float | None = None) -> Solution:
    """The best rig and poses from a first estimate; ``robust_px`` is the scale of Geman-McClure's weights, if any.

    Raises:
        CalibrationError: the normal equations are singular: the views leave something undetermined.
    """
    shared, cost, damping = _pack(rig), np.inf, 1e-4
    poses = poses.copy()
    H, g, cost = _normal_equations(problem, rig, poses, robust_px)
    for _ in range(_ITERATIONS):
        step = _solve_damped(H, g, damping)
        moved = shared + step[: len(shared)], poses + step[len(shared) :].reshape(-1, 6)
        trial = _unpack(moved[0], rig)
        H_new, g_new, cost_new = _normal_equations(problem, trial, moved[1], robust_px)
        if not cost_new < cost:
            damping *= 10.0
            if damping > 1e8:
                break
            continue
        done = cost - cost_new < _CONVERGED * cost
        (shared, poses), rig, H, g, cost, damping = moved, trial, H_new, g_new, cost_new, max(damping * 0.1, 1e-12)
        if done:
            break
    residuals = _residuals(problem, rig, poses)
    return Solution(rig, poses, residuals, _covariance(problem, residuals, H, len(shared)))


def spread(residuals: Array, used: Mask) -> float:
    """Standard deviation of a coordinate's error, pixels, by the median absolute deviation: outliers do not enter."""
    return float(_MAD_TO_SIGMA * np.median(np.abs(residuals[used])))


def _pack(rig: StereoRig) -> Array:
    lenses = [[*(lens.fx, lens.fy, lens.cx, lens.cy), *lens.distortion] for lens in (rig.left, rig.right)]
    return np.concatenate([*map(np.asarray, lenses), rig.turn, rig.T])


def _unpack(shared: Array, like: StereoRig) -> StereoRig:
    size = 4 + len(like.left.distortion)
    left, right = (_lens(part) for part in (shared[:size], shared[size : 2 * size]))
    R = np.asarray(cv2.Rodrigues(shared[2 * size : 2 * size + 3])[0], dtype=np.float64)
    return StereoRig(like.width, like.height, left, right, R, shared[2 * size + 3 :])


def _lens(numbers: Array) -> Lens:
    fx, fy, cx, cy = (float(number) for number in numbers[:4])
    return Lens(fx, fy, cx, cy, numbers[4:])


def _project(lens: Lens, pose: Array, objects: Array) -> tuple[Array, Array, Array]:
    """Pixels (N, 2) with their derivatives (N, 2, 6) by the pose and (N, 2, 4 + D) by the lens."""
    points, jacobian = cv2.projectPoints(objects, pose[:3], pose[3:], lens.matrix, lens.distortion)
    J = np.asarray(jacobian, dtype=np.float64).reshape(len(objects), 2, -1)
    return np.asarray(points, dtype=np.float64).reshape(-1, 2), J[:, :, :6], J[:, :, 6:]


def _in_right(rig: StereoRig, pose: Array) -> tuple[Array, Array, Array]:
    """The board's pose (6,) in the right camera, with derivatives (6, 6) by that in the left one, and by the rig's."""
    r, t, dr_dr1, dr_dt1, dr_dr2, dr_dt2, dt_dr1, dt_dt1, dt_dr2, dt_dt2 = (
        np.asarray(part, dtype=np.float64) for part in cv2.composeRT(pose[:3], pose[3:], rig.turn, rig.T)
    )
    by_left = np.block([[dr_dr1, dr_dt1], [dt_dr1, dt_dt1]])
    by_rig = np.block([[dr_dr2, dr_dt2], [dt_dr2, dt_dt2]])
    return np.concatenate([r.ravel(), t.ravel()]), by_left, by_rig


def _measured(view: View, count: int) -> Array:
    """The corners' places (2, N, 2) in both images, NaN where they were not seen."""
    out = np.full((2, count, 2), np.nan)
    out[0, view.left.ids], out[1, view.right.ids] = view.left.points, view.right.points
    return out


def _residuals(problem: Problem, rig: StereoRig, poses: Array) -> Array:
    out = []
    for view, pose in zip(problem.views, poses, strict=True):
        left = _project(rig.left, pose, problem.objects)[0]
        right = _project(rig.right, _in_right(rig, pose)[0], problem.objects)[0]
        out.append(_measured(view, len(problem.objects)) - np.stack([left, right]))
    return np.array(out)


def _normal_equations(
    problem: Problem, rig: StereoRig, poses: Array, robust_px: float | None
) -> tuple[Array, Array, float]:
    """``H``, ``g`` and the cost at an estimate, the shared parameters first, then six for each view."""
    lens_size = 4 + len(rig.left.distortion)
    shared = 2 * lens_size + 6
    H = np.zeros((shared + 6 * len(poses), shared + 6 * len(poses)))
    g, cost = np.zeros(len(H)), 0.0
    for k, (view, pose) in enumerate(zip(problem.views, poses, strict=True)):
        right_pose, by_left, by_rig = _in_right(rig, pose)
        measured = _measured(view, len(problem.objects))
        for side, lens, its_pose in ((0, rig.left, pose), (1, rig.right, right_pose)):
            used = problem.used[k, side]
            if not used.any():
                continue
            points, by_pose, by_lens = _project(lens, its_pose, problem.objects[used])
            error = measured[side, used] - points
            J = np.zeros((len(error), 2, shared + 6))
            J[:, :, side * lens_size : (side + 1) * lens_size] = by_lens
            J[:, :, shared:] = by_pose if side == 0 else by_pose @ by_left
            if side == 1:
                J[:, :, 2 * lens_size : shared] = by_pose @ by_rig
            squared = (error**2).sum(axis=1)
            weight, value = _robust(squared, robust_px)
            cost += float(value.sum())
            at = np.r_[0:shared, shared + 6 * k : shared + 6 * k + 6]
            flat, weights = J.reshape(-1, shared + 6), np.repeat(weight, 2)
            H[np.ix_(at, at)] += flat.T @ (flat * weights[:, None])
            g[at] += flat.T @ (error.ravel() * weights)
    for begin, lens in ((0, rig.left), (lens_size, rig.right)):
        at = np.arange(begin + 4 + _POLYNOMIAL, begin + lens_size)
        denominator = lens.distortion[_POLYNOMIAL:]
        H[at, at] += _PRIOR
        g[at] -= _PRIOR * denominator
        cost += _PRIOR * float(denominator @ denominator)
    return H, g, cost


def _robust(squared: Array, scale: float | None) -> tuple[Array, Array]:
    """Geman-McClure's weights and costs (N,) of squared errors, those of plain least squares without a scale."""
    if scale is None:
        return np.ones_like(squared), squared
    ratio = scale**2 / (scale**2 + squared)
    return ratio**2, squared * ratio


def _solve_damped(H: Array, g: Array, damping: float) -> Array:
    """A step of Levenberg-Marquardt, in units in which every parameter's own curvature is one."""
    scale = np.sqrt(np.maximum(np.diag(H), 1e-12))
    scaled = H / np.outer(scale, scale) + damping * np.eye(len(H))
    return np.asarray(np.linalg.solve(scaled, g / scale) / scale)


def _covariance(problem: Problem, residuals: Array, H: Array, shared: int) -> Array:
    """Covariance of the shared parameters, from the normal equations and the residuals' own variance."""
    scale = np.sqrt(np.maximum(np.diag(H), 1e-300))
    scaled = H / np.outer(scale, scale)
    # A lens's parameters are correlated, a useful set of them by far less than the digits that there are.
    if not np.isfinite(scaled).all() or np.linalg.cond(scaled) > 1e13:
        raise CalibrationError(
            "the views leave the lenses undetermined: tilt the board to all sides, near and far, and into the corners"
        )
    freedom = 2 * int(problem.used.sum()) - len(H)
    if freedom <= 0:
        raise CalibrationError("there are fewer corners than unknowns: take more pairs, with more of the board in them")
    variance = float((residuals[problem.used] ** 2).sum()) / freedom
    return np.asarray(variance * (np.linalg.inv(scaled) / np.outer(scale, scale))[:shared, :shared])
