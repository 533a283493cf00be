"""A report that a person can judge a calibration by: figures, and pictures of what remains."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from services.sensors.calibration.calibrate import Calibration, Pair
from services.sensors.calibration.errors import CalibrationError
from services.sensors.calibration.quality import CELLS
from services.sensors.calibration.rectify import Rectifier, rectified_points
from services.sensors.calibration.stereo import StereoSolution

Array = NDArray[np.float64]
Image = NDArray[np.uint8]

SIDES = ("left", "right")
_LEFT, _RIGHT, _INK = "#2f6db3", "#c8553d", "#23272e"
_ARROW_PART = 0.04
"""Length of the arrow of a typical residual, as a part of the image's width."""
_LINES = 16
_WIDEST = 1400
"""Greatest width of the picture of a rectified pair, pixels."""


def figures(result: Calibration) -> dict[str, Any]:
    """Every figure of a calibration, as JSON holds it."""
    rig, quality, camera = result.found.solution.rig, result.quality, result.rectifier.camera
    vertical = vertical_errors(result.found, result.rectifier)
    lenses = {}
    for name, lens, sigma in zip(SIDES, (rig.left, rig.right), quality.focal_sigma, strict=True):
        lenses[name] = {
            **{key: round(getattr(lens, key), 4) for key in ("fx", "fy", "cx", "cy")},
            "distortion": [round(float(value), 6) for value in lens.distortion],
            "focal_sigma_percent": round(100 * sigma, 4),
        }
    return {
        "board": str(result.board),
        "width": rig.width,
        "height": rig.height,
        "pairs_used": len(result.found.problem.views),
        "dropped": result.dropped,
        "corners": int(result.found.problem.used.sum()),
        "reprojection_px": round(quality.rms, 4),
        "reprojection_left_px": round(quality.rms_left, 4),
        "reprojection_right_px": round(quality.rms_right, 4),
        "vertical_px": round(float(np.sqrt((vertical**2).mean())), 4),
        **lenses,
        "baseline_m": round(rig.baseline, 6),
        "baseline_sigma_percent": round(100 * quality.baseline_sigma, 4),
        "turn_deg": [round(float(value), 4) for value in np.degrees(rig.turn)],
        "coverage": {name: round(value, 3) for name, value in zip(SIDES, quality.coverage, strict=True)},
        "tilt_deg": round(float(np.degrees(quality.tilt)), 1),
        "distances_m": [round(value, 3) for value in quality.depths],
        "rectified": {
            "fx": round(camera.fx, 4),
            "cx": round(camera.cx, 4),
            "cy": round(camera.cy, 4),
            "baseline_m": round(camera.baseline, 6),
        },
        "warnings": list(quality.warnings),
    }


def write_report(folder: Path, result: Calibration, pair: Pair) -> None:
    """Writes ``report.json``, ``residuals.png``, ``coverage.png`` and, of one pair of images, ``rectified.png``.

    Raises:
        CalibrationError: the folder cannot be written.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "report.json").write_text(json.dumps(figures(result), indent=2) + "\n", encoding="utf-8")
        draw_residuals(result).savefig(folder / "residuals.png", dpi=110)
        draw_coverage(result).savefig(folder / "coverage.png", dpi=110)
        encoded = cv2.imencode(".png", draw_rectified(result.rectifier, pair))[1]
        (folder / "rectified.png").write_bytes(encoded.tobytes())
    except OSError as error:
        raise CalibrationError(f"cannot write the report into {folder}: {error.strerror}") from None


def vertical_errors(found: StereoSolution, rectifier: Rectifier) -> Array:
    """Differences (N,) of the rows, pixels, on which the two rectified images show the same corners."""
    out = []
    for k, view in enumerate(found.problem.views):
        ids, left, right = np.intersect1d(view.left.ids, view.right.ids, return_indices=True)
        both = found.problem.used[k, 0, ids] & found.problem.used[k, 1, ids]
        if not both.any():
            continue
        points = view.left.points[left][both], view.right.points[right][both]
        first, second = rectified_points(found.solution.rig, rectifier, *points)
        out.append(first[:, 1] - second[:, 1])
    return np.concatenate(out) if out else np.zeros(0)


def draw_residuals(result: Calibration) -> Figure:
    """Where each corner was measured beside where the calibration has it, enlarged: noise points everywhere alike."""
    figure = Figure(figsize=(12, 5), layout="constrained")
    problem, solution = result.found.problem, result.found.solution
    typical = max(result.quality.rms, 1e-6)
    for side, axes in enumerate(figure.subplots(1, 2)):
        used = problem.used[:, side]
        points = np.concatenate(
            [seen.points[used[k, seen.ids]] for k, seen in enumerate(_of(view, side) for view in problem.views)]
        )
        residuals = np.concatenate(
            [
                solution.residuals[k, side, seen.ids][used[k, seen.ids]]
                for k, seen in enumerate(_of(view, side) for view in problem.views)
            ]
        )
        scale = typical / (_ARROW_PART * solution.rig.width)
        colour = (_LEFT, _RIGHT)[side]
        axes.quiver(
            *points.T, *residuals.T, angles="xy", scale_units="xy", scale=scale, color=colour, width=0.0018, zorder=3
        )
        rms = (result.quality.rms_left, result.quality.rms_right)[side]
        _frame(axes, result, f"{SIDES[side]}: {rms:.3f} px RMS, arrows {1 / scale:.0f} times as long")
    return figure


def draw_coverage(result: Calibration) -> Figure:
    """Where in the images corners were seen, and how far away and how tilted the board was."""
    figure = Figure(figsize=(15, 4.4), layout="constrained")
    left, right, poses = figure.subplots(1, 3, width_ratios=(1, 1, 0.8))
    rig, problem = result.found.solution.rig, result.found.problem
    for side, axes in enumerate((left, right)):
        cells = result.quality.cells[side]
        axes.imshow(
            np.where(cells > 0, cells, np.nan), extent=(0, rig.width, rig.height, 0), cmap="YlGn", vmin=0, zorder=1
        )
        for k, seen in enumerate(_of(view, side) for view in problem.views):
            points = seen.points[problem.used[k, side, seen.ids]]
            axes.plot(*points.T, ".", color=(_LEFT, _RIGHT)[side], ms=3, zorder=3)
        axes.set_xticks(np.linspace(0, rig.width, CELLS[1] + 1), minor=True)
        axes.set_yticks(np.linspace(0, rig.height, CELLS[0] + 1), minor=True)
        axes.grid(which="minor", color="0.8", lw=0.6)
        covered = result.quality.coverage[side]
        _frame(axes, result, f"{SIDES[side]}: corners in {100 * covered:.0f} % of the cells")
    tilts = np.degrees(np.arccos(np.clip(_normals(result.found)[:, 2], -1.0, 1.0)))
    poses.plot(tilts, result.found.solution.poses[:, 5], "o", color=_INK, ms=5)
    poses.set_xlabel("tilt of the board against the left image [degrees]")
    poses.set_ylabel("distance [m]")
    poses.set_xlim(0, max(60.0, 1.1 * float(tilts.max())))
    poses.set_ylim(0, None)
    poses.grid(alpha=0.25)
    poses.set_title(f"{len(problem.views)} poses of the board", loc="left", fontsize=11)
    return figure


def draw_rectified(rectifier: Rectifier, pair: Pair) -> Image:
    """A rectified pair side by side with horizontal lines: each crosses the same things in both."""
    images = [
        image if image.ndim == 3 else cv2.cvtColor(image, cv2.COLOR_GRAY2BGR) for image in rectifier.rectify(*pair[1:])
    ]
    both = np.hstack(images)
    factor = min(1.0, _WIDEST / both.shape[1])
    drawn = cv2.resize(both, None, fx=factor, fy=factor, interpolation=cv2.INTER_AREA) if factor < 1.0 else both
    for k in range(1, _LINES):
        row = round(k * drawn.shape[0] / _LINES)
        cv2.line(drawn, (0, row), (drawn.shape[1] - 1, row), ((80, 200, 80), (60, 160, 240))[k % 2], 1)
    return np.asarray(drawn, dtype=np.uint8)


def _of(view: Any, side: int) -> Any:  # noqa: ANN401, both detections of a view alike
    return view.left if side == 0 else view.right


def _normals(found: StereoSolution) -> Array:
    rotations = np.array([cv2.Rodrigues(pose[:3])[0] for pose in found.solution.poses])
    return np.asarray(rotations[:, :, 2])


def _frame(axes: Axes, result: Calibration, title: str) -> None:
    rig = result.found.solution.rig
    axes.set_xlim(0, rig.width)
    axes.set_ylim(rig.height, 0)
    axes.set_aspect("equal")
    axes.set_title(title, loc="left", fontsize=11)
