"""How good a calibration is: coverage of the images and of the board's poses, and what remains uncertain."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from common import geometry
from services.sensors.calibration.errors import CalibrationError
from services.sensors.calibration.stereo import StereoSolution

Array = NDArray[np.float64]

CELLS = (6, 8)
"""Rows and columns of the grid by which coverage is counted."""
MAX_RMS_PX = 1.0
MIN_TILT = np.radians(20.0)
"""Least angle between the two boards that differ most: of parallel boards, focal length and distance are one."""
MAX_FOCAL_SIGMA = 0.003
"""Greatest standard deviation of a focal length or of the baseline, as a part of it."""

_GOOD_RMS_PX, _GOOD_SIGMA, _GOOD_COVERAGE, _GOOD_TILT = 0.5, 0.001, 0.6, np.radians(40.0)
_GOOD_DEPTHS = 1.4
_MANY_OUTLIERS = 0.1


@dataclass(frozen=True, slots=True)
class Quality:
    """Figures of a calibration.

    Attributes:
        rms: reprojection error of all believed corners, pixels; ``rms_left``, ``rms_right``: of one camera's.
        focal_sigma: relative standard deviations of the two focal lengths; ``baseline_sigma``: of the baseline.
        coverage: shares of the cells of each image in which a corner was seen.
        cells: (2, rows, columns) number of corners in each of them.
        tilt: greatest angle between two poses of the board, radians.
        depths: least and greatest distance of the board, metres.
        warnings: what could be better, a sentence each.
    """

    rms: float
    rms_left: float
    rms_right: float
    focal_sigma: tuple[float, float]
    baseline_sigma: float
    coverage: tuple[float, float]
    cells: NDArray[np.int64]
    tilt: float
    depths: tuple[float, float]
    warnings: tuple[str, ...]


def judge(found: StereoSolution) -> Quality:
    """The figures of a calibration.

    Raises:
        CalibrationError: it is not to be used; the sentence says why and what to do.
    """
    quality = _measure(found)
    if quality.tilt < MIN_TILT:
        raise CalibrationError(
            f"the board was tilted by {np.degrees(quality.tilt):.0f} degrees at most between two views, which leaves "
            f"the focal length open: tilt it by {np.degrees(_GOOD_TILT):.0f} degrees, to all sides"
        )
    if quality.rms > MAX_RMS_PX:
        raise CalibrationError(
            f"the corners are {quality.rms:.2f} pixels off where {MAX_RMS_PX:g} is allowed: the board is not flat, "
            "or a lens is no pinhole's (try --coefficients 8)"
        )
    worst = max(*quality.focal_sigma, quality.baseline_sigma)
    if worst > MAX_FOCAL_SIGMA:
        what = "baseline" if worst == quality.baseline_sigma else "focal length"
        raise CalibrationError(
            f"the {what} is only known to {100 * worst:.1f} %, {100 * MAX_FOCAL_SIGMA:g} % is needed: take more pairs, "
            "with the board tilted to all sides, near and far, and into the images' corners"
        )
    return quality


def _measure(found: StereoSolution) -> Quality:
    solution, problem = found.solution, found.problem
    rig = solution.rig
    lens = 4 + len(rig.left.distortion)
    sides = [np.zeros_like(problem.used) for _ in range(2)]
    for side in range(2):
        sides[side][:, side] = problem.used[:, side]
    variances = np.diag(solution.covariance)
    focal = [float(np.sqrt(variances[at]) / f) for at, f in ((0, rig.left.fx), (lens, rig.right.fx))]
    along = rig.T / rig.baseline
    baseline = float(np.sqrt(along @ solution.covariance[-3:, -3:] @ along) / rig.baseline)
    cells = coverage(found)
    normals = geometry.so3_exp(solution.poses[:, :3])[:, :, 2]
    tilt = float(np.arccos(np.clip(normals @ normals.T, -1.0, 1.0)).max())
    depths = float(solution.poses[:, 5].min()), float(solution.poses[:, 5].max())
    covered = float((cells[0] > 0).mean()), float((cells[1] > 0).mean())
    rms = solution.rms(problem.used)
    left, right = (solution.rms(mask) for mask in sides)
    warnings = _warnings(found, rms, max(*focal, baseline), cells, tilt, depths)
    return Quality(rms, left, right, (focal[0], focal[1]), baseline, covered, cells, tilt, depths, warnings)


def coverage(found: StereoSolution) -> NDArray[np.int64]:
    """Believed corners (2, rows, columns) in each cell of the left and the right image."""
    rig, used = found.solution.rig, found.problem.used
    out = np.zeros((2, *CELLS), dtype=np.int64)
    for k, view in enumerate(found.problem.views):
        for side, seen in enumerate((view.left, view.right)):
            points = seen.points[used[k, side, seen.ids]]
            rows = np.clip(points[:, 1] / rig.height * CELLS[0], 0, CELLS[0] - 1).astype(int)
            columns = np.clip(points[:, 0] / rig.width * CELLS[1], 0, CELLS[1] - 1).astype(int)
            np.add.at(out[side], (rows, columns), 1)
    return out


def _warnings(
    found: StereoSolution, rms: float, sigma: float, cells: NDArray[np.int64], tilt: float, depths: tuple[float, float]
) -> tuple[str, ...]:
    """What could be better."""
    out = []
    if rms > _GOOD_RMS_PX:
        out.append(
            f"the corners are {rms:.2f} pixels off, a good set has less than {_GOOD_RMS_PX:g}: is the board flat?"
        )
    if sigma > _GOOD_SIGMA:
        out.append(f"focal lengths or baseline are known to {100 * sigma:.2f} %: more and more tilted views help")
    for side, counts in zip(("left", "right"), cells, strict=True):
        if (counts > 0).mean() < _GOOD_COVERAGE:
            part = f"the {_emptiest(counts)} of the {side} image saw little of the board"
            out.append(f"{part} ({100 * (counts > 0).mean():.0f} % of it is covered): the distortion is a guess there")
    if tilt < _GOOD_TILT:
        out.append(f"the board was tilted by {np.degrees(tilt):.0f} degrees at most: tilt it more")
    if depths[1] < _GOOD_DEPTHS * depths[0]:
        out.append(f"the board was always {depths[0]:.2f} to {depths[1]:.2f} m away: show it near and far")
    seen = sum(len(view.left) + len(view.right) for view in found.problem.views)
    lost = seen - int(found.problem.used.sum())
    if lost > _MANY_OUTLIERS * seen:
        out.append(f"{lost} corners were left out as outliers: look for reflections on the board")
    return tuple(out)


def _emptiest(cells: NDArray[np.int64]) -> str:
    """The quarter of an image with the fewest covered cells, in words."""
    rows, columns = cells.shape[0] // 2, cells.shape[1] // 2
    quarters = {
        "upper left": cells[:rows, :columns],
        "upper right": cells[:rows, columns:],
        "lower left": cells[rows:, :columns],
        "lower right": cells[rows:, columns:],
    }
    return min(quarters, key=lambda name: (quarters[name] > 0).mean())
