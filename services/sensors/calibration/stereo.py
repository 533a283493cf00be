"""From the views of a board to the rig: a first estimate, outliers out, joint refinement, and what must be refused."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from common import geometry
from services.sensors.calibration.errors import CalibrationError
from services.sensors.calibration.intrinsics import Coefficients, Monocular, calibrate_camera
from services.sensors.calibration.refinement import Mask, Problem, Solution, solve, spread
from services.sensors.calibration.rig import StereoRig
from services.sensors.calibration.views import MIN_VIEWS, View

Array = NDArray[np.float64]

_OUTLIER = 5.0
"""Standard deviations at which a corner's error is no noise any more."""
_LEAST_PX = 0.15
"""No corner is found more exactly than this on every board, however small the errors of most are."""
_MOST_OUT = 0.3
"""Share of a view's corners whose loss makes the whole view suspect."""
_SIDEWAYS = 0.7
"""Least part of the baseline that must lie along the image's rows."""
_MAX_TURN = np.radians(30.0)


@dataclass(frozen=True, slots=True)
class StereoSolution:
    """The rig, and which views and corners it was computed from.

    Attributes:
        solution: see :class:`Solution`.
        problem: the views that were kept, and the corners that were believed.
        dropped: reasons by the names of the views that were not.
    """

    solution: Solution
    problem: Problem
    dropped: dict[str, str]


def calibrate_stereo(
    views: Sequence[View], objects: Array, size: tuple[int, int], coefficients: Coefficients
) -> StereoSolution:
    """The rig from views that :func:`select` let through; ``objects`` (N, 3) are the board's corners, metres.

    Raises:
        CalibrationError: the images are no basis for a calibration; the sentence says why.
    """
    views, dropped = list(views), {}
    left = calibrate_camera([v.left for v in views], objects, size, coefficients, "left")
    right = calibrate_camera([v.right for v in views], objects, size, coefficients, "right")
    rig = _first_rig(left, right, size)
    problem, poses, scale = Problem.of(views, objects), left.poses, 2.0
    for _ in range(2):
        solution = solve(problem, rig, poses, scale)
        scale = 3.0 * max(spread(solution.residuals, problem.used), _LEAST_PX / 3.0)
        rig, poses = solution.rig, solution.poses
    outliers = _outliers(solution, problem)
    bad = outliers.sum(axis=(1, 2)) > _MOST_OUT * problem.used.sum(axis=(1, 2))
    for k in np.flatnonzero(bad).tolist():
        dropped[views[k].name] = _why_out(solution, problem, k, max(left.errors[k], right.errors[k]))
    _check_enough(int((~bad).sum()), len(views), dropped)
    kept = Problem([v for v, out in zip(views, bad, strict=True) if not out], objects, (problem.used & ~outliers)[~bad])
    final = solve(kept, rig, poses[~bad])
    _check_arrangement(final.rig)
    return StereoSolution(final, kept, dropped)


def _first_rig(left: Monocular, right: Monocular, size: tuple[int, int]) -> StereoRig:
    """The rig of two cameras by themselves: among the transforms that single views tell, the one nearest to all."""
    T_left_board, T_right_board = (_transforms(camera.poses) for camera in (left, right))
    T_right_left = T_right_board @ geometry.inverse(T_left_board)
    apart = np.array([np.linalg.norm(geometry.log(geometry.inverse(T) @ T_right_left), axis=1) for T in T_right_left])
    T = T_right_left[int(np.argmin(np.median(apart, axis=1)))]
    return StereoRig(*size, left.lens, right.lens, T[:3, :3], T[:3, 3])


def _transforms(poses: Array) -> Array:
    """Transforms (V, 4, 4) of rotation vectors and translations (V, 6)."""
    return geometry.transform(geometry.so3_exp(poses[:, :3]), poses[:, 3:])


def _outliers(solution: Solution, problem: Problem) -> Mask:
    """Corners (V, 2, N) whose error cannot be noise."""
    sigma = max(spread(solution.residuals, problem.used), _LEAST_PX / 2.0)
    with np.errstate(invalid="ignore"):
        far = np.linalg.norm(solution.residuals, axis=-1) > _OUTLIER * sigma
    return np.asarray(far & problem.used)


def _why_out(solution: Solution, problem: Problem, view: int, alone: float) -> str:
    """Why a view contradicts the others; ``alone`` is its error, pixels, in each camera by itself."""
    errors = np.linalg.norm(solution.residuals[view], axis=-1)
    # A robust pose follows one of the two images.
    typical = max(float(np.median(side[used])) for side, used in zip(errors, problem.used[view], strict=True))
    if alone < 0.5 * typical:
        return (
            f"left and right image do not show the board at the same moment: together they are {typical:.1f} pixels "
            f"off, each by itself {alone:.1f}"
        )
    return f"its corners are {typical:.1f} pixels off: the board is bent, or the corners were mistaken"


def _check_enough(kept: int, count: int, dropped: dict[str, str]) -> None:
    if kept >= max(MIN_VIEWS, count / 2):
        return
    name, reason = next(iter(dropped.items()))
    raise CalibrationError(
        f"only {kept} of {count} pairs of images agree with each other (pair {name}: {reason}): photograph a still "
        "board with both cameras at once, and keep the pairs together"
    )


def _check_arrangement(rig: StereoRig) -> None:
    """Refuses what is no pair of cameras side by side, the left one to the left.

    Raises:
        CalibrationError: see the sentences.
    """
    # The right camera's centre in the left camera's frame.
    x, y, z = (float(value) for value in -rig.R.T @ rig.T)
    length = float(np.linalg.norm([x, y, z]))
    if length < 0.005:
        raise CalibrationError(
            f"the two cameras stand at one place ({1e3 * length:.1f} mm apart): left and right images are of one camera"
        )
    if float(np.linalg.norm(rig.turn)) > _MAX_TURN:
        raise CalibrationError(
            f"the right camera is turned against the left one by {np.degrees(np.linalg.norm(rig.turn)):.0f} degrees: "
            "both must look the same way, and neither stand on its head"
        )
    if abs(x) < _SIDEWAYS * length:
        raise CalibrationError(
            f"the right camera stands {x:+.3f} m right, {-y:+.3f} m above and {z:+.3f} m before the left one: they "
            "must stand side by side"
        )
    if x < 0.0:
        raise CalibrationError(
            f"the cameras are swapped: what is named right stands {-x:.3f} m to the left; exchange the two folders, or "
            "the two devices"
        )
