"""The figures of the offline commands, and the files that they write."""

from __future__ import annotations

import csv
import io
import json
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cli.errors import CommandError
from services.estimator.coverage import dropouts, measure
from services.estimator.offline import Drift, LocalizationRun, OdometryRun

Array = NDArray[np.float64]


def odometry_figures(run: OdometryRun, drift: Drift | None, truth: str = "truth") -> dict[str, Any]:
    """Frames a second (reading included, compilation not), times by stage, and the drift where truth is known.

    ``truth`` says what the drift is measured against.
    """
    total = run.milliseconds + run.reading_milliseconds
    return {
        "frames": len(run.poses),
        "lost": int((~run.success).sum()),
        "frames_per_second": round(1e3 * len(total) / float(total.sum()), 2),
        "milliseconds": _percentiles(run.milliseconds),
        "reading_milliseconds": _percentiles(run.reading_milliseconds),
        "stages_milliseconds": {name: _percentiles(values) for name, values in run.stages.items()},
        "drift": None
        if drift is None
        else {
            "against": truth,
            "end_point_percent": round(100 * drift.end_point, 3),
            "end_rotation_deg": round(float(np.degrees(drift.rotation)), 4),
            "length_m": round(drift.length, 3),
            "median_frame_error_m": round(drift.frame_error, 5),
        },
    }


def localization_figures(run: LocalizationRun) -> dict[str, Any]:
    """Coverage and dropouts, of the whole system and by stream, times, and errors of localized frames where known."""
    errors = run.position_errors, run.rotation_errors
    position, rotation = (None if values is None else values[run.success] for values in errors)
    return {
        "frames": len(run.success),
        "localized": int(run.success.sum()),
        "coverage": round(run.coverage, 5),
        "driven_m": round(measure(run.success, run.distance).metres, 3),
        "dropouts_m": _dropouts(run.success, run.distance),
        "streams": {
            name: {"coverage": round(float(success.mean()), 5), "dropouts_m": _dropouts(success, run.distance)}
            for name, success in run.streams.items()
        },
        "position_error_m": None if position is None else _errors(position),
        "rotation_error_deg": None if rotation is None else _errors(np.degrees(rotation)),
        "milliseconds": _percentiles(run.milliseconds),
    }


def poses_text(poses: Array) -> str:
    """Poses (N, 4, 4) in KITTI's format: the first three rows of each, 12 numbers a line."""
    return "".join(" ".join(f"{value:.9e}" for value in pose[:3].ravel()) + "\n" for pose in poses)


def localization_csv(run: LocalizationRun) -> str:
    """A line for each frame: whether, by which streams and against which vertex it was localized, and how well."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    header = (
        "frame",
        "localized",
        *run.streams,
        "vertex",
        "inliers",
        "position_error_m",
        "rotation_error_rad",
        "reason",
    )
    writer.writerow(header)
    for index, success in enumerate(run.success):
        streams = (int(localized[index]) for localized in run.streams.values())
        errors = ("" if e is None else f"{e[index]:.6f}" for e in (run.position_errors, run.rotation_errors))
        writer.writerow(
            (index, int(success), *streams, run.trunk[index], run.inliers[index], *errors, run.reasons[index])
        )
    return out.getvalue()


def write_localization(path: Path, run: LocalizationRun, figures: dict[str, Any]) -> None:
    """Writes what the file's name asks for: a line a frame (``.csv``), the figures (``.json``), else the poses."""
    if path.suffix == ".csv":
        write(path, localization_csv(run))
    elif path.suffix == ".json":
        write(path, json.dumps(figures, indent=2) + "\n")
    else:
        write(path, poses_text(run.poses))


def write(path: Path, text: str) -> None:
    """Writes a text file.

    Raises:
        CommandError: it cannot be written.
    """
    try:
        path.write_text(text, encoding="utf-8")
    except OSError as error:
        raise CommandError(f"cannot write {path}: {error.strerror}") from None


def check_writable(path: Path | None) -> None:
    """Raises at once, before the work, where a file could not be written afterwards."""
    if path is None:
        return
    if path.is_dir():
        raise CommandError(f"cannot write {path}: it is a folder")
    if not path.absolute().parent.is_dir():
        raise CommandError(f"cannot write {path}: there is no folder {path.parent}")


def _dropouts(success: NDArray[np.bool_], distance: Array) -> list[float]:
    return [round(float(metres), 3) for metres in dropouts(success, distance)]


def _percentiles(values: Array) -> dict[str, float]:
    p50, p99 = np.percentile(values, [50, 99]) if len(values) else (0.0, 0.0)
    return {"p50": round(float(p50), 3), "p99": round(float(p99), 3)}


def _errors(values: Array) -> dict[str, float] | None:
    if not len(values):
        return None
    median, p95 = np.percentile(values, [50, 95])
    return {"median": round(float(median), 5), "p95": round(float(p95), 5), "max": round(float(values.max()), 5)}
