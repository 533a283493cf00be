"""The demo's picture: the taught and the repeated path, and the error along it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure

from cli.demo.errors import PathErrors, path_errors
from cli.demo.recorder import Recording
from cli.demo.report import SETTLING_M, Report, clock_times
from common.geometry import Array

_TAUGHT = "#9aa5b1"
_LATERAL = "#0b6e99"
_HEADING = "#c8553d"


def plot_paths(taught: Recording, repeated: Recording, report: Report, path: Path) -> None:
    """Draws the picture as a PNG."""
    errors = path_errors(taught.poses(), repeated.poses())
    figure = Figure(figsize=(12, 9), dpi=120, layout="constrained", facecolor="white")
    grid = figure.add_gridspec(2, 2, height_ratios=(1.75, 1))
    _draw_map(figure, figure.add_subplot(grid[0, :]), taught.poses(), repeated.poses(), errors)
    _draw_lateral(figure.add_subplot(grid[1, 0]), errors, report)
    _draw_heading(figure.add_subplot(grid[1, 1]), errors, report)
    figure.suptitle(
        f"{clock_times(report)}: {report.route_length_m:.0f} m "
        f"at {report.mean_speed_m_s:.1f} m/s, localized at {report.localization['rate_hz']:.1f} Hz",
        fontsize=14,
        fontweight="bold",
    )
    figure.savefig(path)


def _draw_map(figure: Figure, axes: Axes, taught: Array, repeated: Array, errors: PathErrors) -> None:
    axes.plot(*taught[:, :2, 3].T, color=_TAUGHT, linewidth=9, solid_capstyle="round", alpha=0.55, label="taught")
    points = repeated[:, None, :2, 3]
    segments = np.concatenate([points[:-1], points[1:]], axis=1)
    line = LineCollection(list(segments), cmap="viridis", linewidths=2.6)
    line.set_array(np.abs(errors.lateral[:-1]) * 100.0)
    line.set_clim(0.0, max(5.0, float(np.percentile(np.abs(errors.lateral), 95)) * 100.0))
    axes.add_collection(line)
    axes.plot([], [], color=line.get_cmap()(0.2), linewidth=2.6, label="repeated")
    for name, pose, marker, offset in (("start", repeated[0], "o", (12, 4)), ("stop", repeated[-1], "s", (12, -12))):
        axes.plot(*pose[:2, 3], marker, color="black", markersize=8, zorder=3)
        axes.annotate(name, tuple(pose[:2, 3]), xytext=offset, textcoords="offset points", fontsize=11)
    axes.set_aspect("equal")
    axes.margins(x=0.08, y=0.08)
    axes.set_xlabel("east [m]")
    axes.set_ylabel("north [m]")
    axes.grid(alpha=0.25)
    axes.legend(loc="center", frameon=False, fontsize=11)
    figure.colorbar(line, ax=axes, shrink=0.8, pad=0.01, label="lateral error [cm]")


def _draw_lateral(axes: Axes, errors: PathErrors, report: Report) -> None:
    axes.axvspan(0.0, SETTLING_M, color="0.93", label="settling, not counted")
    axes.axhline(0.0, color="0.6", linewidth=0.8)
    axes.plot(errors.arclength, errors.lateral * 100.0, color=_LATERAL, linewidth=1.4)
    row = report.lateral_error_m
    axes.set_title(
        f"lateral error: RMS {row['rms'] * 100:.1f} cm, 95 % {row['p95'] * 100:.1f} cm, max {row['max'] * 100:.1f} cm",
        fontsize=10.5, loc="left",
    )  # fmt: skip
    axes.set_xlabel("along the taught path [m]")
    axes.set_ylabel("left of the path [cm]")
    axes.legend(loc="upper right", frameon=False)
    axes.grid(alpha=0.25)


def _draw_heading(axes: Axes, errors: PathErrors, report: Report) -> None:
    axes.axvspan(0.0, SETTLING_M, color="0.93")
    axes.axhline(0.0, color="0.6", linewidth=0.8)
    axes.plot(errors.arclength, np.degrees(errors.heading), color=_HEADING, linewidth=1.4)
    row = report.heading_error_deg
    axes.set_title(f"heading error: RMS {row['rms']:.1f}°, 95 % {row['p95']:.1f}°, max {row['max']:.1f}°",
                   fontsize=10.5, loc="left")  # fmt: skip
    axes.set_xlabel("along the taught path [m]")
    axes.set_ylabel("to the left [°]")
    axes.grid(alpha=0.25)
