"""A report that a person can judge a mounting by: figures, and a picture of the drive as camera and wheels tell it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from common import geometry
from services.sensors.calibration.drive import Drive
from services.sensors.calibration.errors import CalibrationError
from services.sensors.calibration.file import MountingTable
from services.sensors.calibration.mounting import Course, Mounting

Array = NDArray[np.float64]

_CAMERA, _WHEELS, _SLIPPED = "#2f6db3", "#9aa5b1", "#c8553d"


def figures(found: Mounting, drive: Drive) -> dict[str, Any]:
    """Every figure of a mounting, as JSON holds it."""
    table, course = MountingTable.of(found.T_vehicle_camera), Course.of(drive.wheel_motions)
    return {
        "position_m": [round(value, 4) for value in table.position],
        "position_sigma_m": [round(value, 4) for value in found.place_sigma],
        "roll_deg": _degrees(table.roll),
        "pitch_deg": _degrees(table.pitch),
        "yaw_deg": _degrees(table.yaw),
        "roll_pitch_sigma_deg": _degrees(found.roll_pitch_sigma),
        "yaw_sigma_deg": _degrees(found.yaw_sigma),
        "length_m": round(course.length, 2),
        "left_deg": round(float(np.degrees(course.left)), 1),
        "right_deg": round(float(np.degrees(course.right)), 1),
        "frames": drive.frames,
        "frames_used": len(drive.wheel_motions) + 1,
        "wheel_delay_s": round(drive.delay, 4),
        "wheel_distance_scale": round(found.wheel_scale, 4),
        "wheel_turn_scale": round(found.turn_scale, 4),
        "residual_m": round(float(np.median(found.residuals)), 4),
        "residual_deg": _degrees(float(np.median(np.abs(found.turn_residuals)))),
        "slipped": round(float(found.slipped.mean()), 3),
        "warnings": [*found.warnings, *drive.warnings],
    }


def write_report(folder: Path, found: Mounting, drive: Drive) -> None:
    """Writes ``report.json`` and ``drive.png``.

    Raises:
        CalibrationError: the folder cannot be written.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "report.json").write_text(json.dumps(figures(found, drive), indent=2) + "\n", encoding="utf-8")
        draw_drive(found, drive).savefig(folder / "drive.png", dpi=110)
    except OSError as error:
        raise CalibrationError(f"cannot write the report into {folder}: {error.strerror}") from None


def draw_drive(found: Mounting, drive: Drive) -> Figure:
    """The vehicle's path by its camera and by its wheels, their turn rates, and what remains on each segment."""
    figure = Figure(figsize=(14, 7.5), layout="constrained")
    grid = figure.add_gridspec(2, 2, width_ratios=(1, 1.25))
    _draw_paths(figure.add_subplot(grid[:, 0]), found, drive)
    _draw_turns(figure.add_subplot(grid[0, 1]), found, drive)
    _draw_residuals(figure.add_subplot(grid[1, 1]), found)
    return figure


def _draw_paths(axes: Axes, found: Mounting, drive: Drive) -> None:
    X = found.T_vehicle_camera
    scales = [found.wheel_scale, found.wheel_scale, found.turn_scale]
    wheels = np.array([geometry.from_xy_yaw(*motion) for motion in drive.wheel_motions * scales])
    for motions, colour, width, name in (
        (wheels, _WHEELS, 4.0, "wheels, scaled"),
        (X @ drive.camera_motions @ geometry.inverse(X), _CAMERA, 1.4, "camera, by this mounting"),
    ):
        axes.plot(*_path(motions)[:, :2].T, color=colour, lw=width, label=name)
    axes.plot(0, 0, "o", color="black", ms=6)
    axes.set_aspect("equal")
    axes.set_xlabel("forward of where the drive began [m]")
    axes.set_ylabel("left [m]")
    axes.set_title("the vehicle's path", loc="left", fontsize=11)
    axes.grid(alpha=0.25)
    axes.legend(frameon=False, loc="upper center", bbox_to_anchor=(0.5, -0.08), ncols=2)


def _draw_turns(axes: Axes, found: Mounting, drive: Drive) -> None:
    times = (drive.after_ns - drive.before_ns[0]) * 1e-9
    seconds = np.maximum((drive.after_ns - drive.before_ns) * 1e-9, 1e-3)
    X = found.T_vehicle_camera
    camera = geometry.so3_log((X @ drive.camera_motions @ geometry.inverse(X))[:, :3, :3])[:, 2]
    for turns, colour, width, name in (
        (drive.wheel_motions[:, 2], _WHEELS, 3.0, "wheels"),
        (camera, _CAMERA, 1.1, "camera"),
    ):
        axes.plot(times, np.degrees(turns / seconds), color=colour, lw=width, label=name)
    axes.set_xlabel("time [s]")
    axes.set_ylabel("turn rate [degrees/s]")
    title = f"turns; the wheels' are {1 / found.turn_scale:.2f} times the camera's, {1e3 * drive.delay:+.0f} ms late"
    axes.set_title(title, loc="left", fontsize=11)
    axes.grid(alpha=0.25)
    axes.legend(frameon=False, loc="best")


def _draw_residuals(axes: Axes, found: Mounting) -> None:
    number = np.arange(len(found.residuals))
    colours = np.where(found.slipped, _SLIPPED, _CAMERA).tolist()
    axes.bar(number, 100 * found.residuals, color=colours, width=0.8)
    axes.set_xlabel("segment, a metre or 30 degrees each")
    axes.set_ylabel("camera against wheels [cm]")
    slipped = f"; red: the wheels slip ({100 * found.slipped.mean():.0f} %)" if found.slipped.any() else ""
    title = f"what remains: {100 * float(np.median(found.residuals)):.1f} cm in the median{slipped}"
    axes.set_title(title, loc="left", fontsize=11)
    axes.grid(alpha=0.25, axis="y")


def _path(motions: Array) -> Array:
    """Places (N + 1, 3) of a frame that moves by motions (N, 4, 4)."""
    T, out = np.eye(4), [np.zeros(3)]
    for motion in motions:
        T = T @ motion
        out.append(T[:3, 3])
    return np.array(out)


def _degrees(radians: float) -> float:
    return round(float(np.degrees(radians)), 3)
