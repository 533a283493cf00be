"""Pictures of what was localized along a path, and of how far was driven on dead reckoning.

They are Figures 7 to 9 of McManus et al., *Shady Dealings*, ICRA 2014.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from numpy.typing import NDArray

from cli.errors import CommandError
from services.estimator.coverage import Coverage, measure, survival
from services.estimator.offline import LocalizationRun

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

MARK_M = 10.0
"""The distance on dead reckoning at which the two systems are compared in words."""
_BASELINE, _INVARIANT, _COMBINED, _NEITHER = "#2f6db3", "#e3a72f", "#3c9a5f", "#23272e"
_OTHERS = ("#7a4fa3", "#c8553d")
_COLOURS = {"baseline": _BASELINE, "plain": _BASELINE, "invariant": _INVARIANT, "combined": _COMBINED}
_ALONG = "along the repeated path [m]"
_BESIDE = ("axes fraction", "data")
_LEAST_SPAN_M = 12.0


@dataclass(frozen=True, slots=True)
class Row:
    """One drive localized against one taught route, for :func:`draw_one_vs_all`.

    Attributes:
        name: of the taught route.
        baseline, invariant: (N,) which frames each stream localized.
    """

    name: str
    baseline: Mask
    invariant: Mask


def draw_one_vs_one(axes: Axes, distance: Array, systems: Mapping[str, Mask]) -> None:
    """Where along the path (N,), metres, each system localized: a row of points each, gaps where it failed (Figure 7).

    ``systems`` are named ``baseline`` (or ``plain``), ``invariant`` or ``combined``, from the top.
    """
    for row, (name, success) in enumerate(systems.items()):
        axes.plot(distance[success], np.full(success.sum(), row), "|", color=_COLOURS[name], ms=9, mew=1.6)
        axes.plot(distance[~success], np.full((~success).sum(), row + 0.3), "x", color="0.6", ms=3, mew=0.8)
        axes.annotate(_percent(success.mean()), (1.01, row), xycoords=_BESIDE, va="center", fontsize=10)
    axes.set_title("|  localized      x  not localized", loc="left", fontsize=10, color="0.35")
    axes.set_yticks(range(len(systems)), [name.capitalize() for name in systems])
    axes.set_ylim(len(systems) - 0.4, -0.6)
    axes.set_xlim(*_span(distance))
    axes.set_xlabel(_ALONG)
    axes.tick_params(axis="y", length=0)
    axes.grid(axis="x", alpha=0.25)


def draw_one_vs_all(axes: Axes, distance: Array, rows: Sequence[Row]) -> None:
    """Which stream localized where along one drive's path (N,), metres, against each of several routes (Figure 8)."""
    kinds = np.array([np.where(row.baseline, 1, 0) + np.where(row.invariant, 2, 0) for row in rows])
    edges = np.concatenate([distance[:1], (distance[:-1] + distance[1:]) / 2, distance[-1:]])
    colours = ListedColormap([_NEITHER, _BASELINE, _INVARIANT, _COMBINED])
    axes.pcolormesh(edges, np.arange(len(rows) + 1), kinds, cmap=colours, vmin=-0.5, vmax=3.5, rasterized=True)
    for line in range(1, len(rows)):
        axes.axhline(line, color="white", linewidth=2.5)
    for index, row in enumerate(rows):
        text = f"{100 * row.baseline.mean():.1f} → {_percent((row.baseline | row.invariant).mean())}"
        axes.annotate(text, (1.01, index + 0.5), xycoords=_BESIDE, va="center", fontsize=9)
    axes.set_yticks(np.arange(len(rows)) + 0.5, [row.name for row in rows])
    axes.invert_yaxis()
    axes.set_ylabel("taught at")
    axes.set_xlabel(_ALONG)
    axes.tick_params(axis="y", length=0)
    kinds_of = (
        ("only baseline", _BASELINE),
        ("only invariant", _INVARIANT),
        ("both", _COMBINED),
        ("neither", _NEITHER),
    )
    handles = [Patch(color=colour, label=name) for name, colour in kinds_of]
    axes.legend(handles=handles, loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=4, frameon=False, fontsize=10)


def draw_dead_reckoning(axes: Axes, systems: Mapping[str, Coverage]) -> None:
    """How likely a lost robot drives farther than a distance before it is localized again (Figure 9)."""
    longest = max((float(c.dropouts.max(initial=0.0)) for c in systems.values()), default=0.0)
    at = np.linspace(0.0, max(_LEAST_SPAN_M, 1.08 * longest), 1200)
    others = iter(_OTHERS)
    for name, coverage in systems.items():
        lost, colour = len(coverage.dropouts), _COLOURS.get(name) or next(others)
        label = f"{name}: {lost} {'loss' if lost == 1 else 'losses'} in {_metres(coverage.metres)}"
        axes.step(at, survival(coverage.dropouts, at), where="post", color=colour, linewidth=2.2, label=label)
        axes.plot(MARK_M, coverage.beyond(MARK_M), "o", color=colour, markersize=6, zorder=3, clip_on=False)
    axes.axvline(MARK_M, color="0.6", linewidth=0.9, linestyle=":", zorder=0)
    shares = ", ".join(f"{name} {_percent(coverage.beyond(MARK_M))}" for name, coverage in systems.items())
    axes.set_title(f"more than {MARK_M:.0f} m after a loss: {shares}", loc="left", fontsize=10.5)
    axes.set_xlim(0.0, at[-1])
    axes.set_ylim(0.0, 1.02)
    axes.set_xlabel("x, driven on dead reckoning [m]")
    axes.set_ylabel("P (farther than x | localization lost)")
    axes.grid(alpha=0.25)
    axes.legend(loc="upper right", fontsize=10, facecolor="white", edgecolor="none", framealpha=1.0)


def plot_one_vs_one(path: Path, title: str, distance: Array, systems: Mapping[str, Mask]) -> None:
    """Figure 7 as a PNG."""
    figure = _figure(title, (11, 1.5 + 0.55 * len(systems)))
    draw_one_vs_one(figure.add_subplot(), distance, systems)
    save(figure, path)


def plot_one_vs_all(path: Path, title: str, distance: Array, rows: Sequence[Row]) -> None:
    """Figure 8 as a PNG."""
    figure = _figure(title, (11, 1.9 + 0.34 * len(rows)))
    draw_one_vs_all(figure.add_subplot(), distance, rows)
    save(figure, path)


def plot_dead_reckoning(path: Path, title: str, systems: Mapping[str, Coverage]) -> None:
    """Figure 9 as a PNG."""
    figure = _figure(title, (8.5, 5.2))
    draw_dead_reckoning(figure.add_subplot(), systems)
    save(figure, path)


def plot_both(
    path: Path, title: str, distance: Array, masks: Mapping[str, Mask], systems: Mapping[str, Coverage]
) -> None:
    """Figures 7 and 9 in one PNG."""
    figure = _figure(title, (11, 6.6))
    grid = figure.add_gridspec(2, 1, height_ratios=(0.35 + 0.35 * len(masks), 3))
    draw_one_vs_one(figure.add_subplot(grid[0]), distance, masks)
    draw_dead_reckoning(figure.add_subplot(grid[1]), systems)
    save(figure, path)


def plot_localization(paths: Sequence[Path], title: str, run: LocalizationRun) -> None:
    """The run of a ``vtr localize``: both figures in one picture, or each in its own."""
    masks = dict(run.streams) if len(run.streams) == 1 else {**run.streams, "combined": run.success}
    systems = {name: measure(success, run.distance) for name, success in masks.items() if name != "invariant"}
    if len(paths) == 1:
        plot_both(paths[0], title, run.distance, masks, systems)
    else:
        plot_one_vs_one(paths[0], title, run.distance, masks)
        plot_dead_reckoning(paths[1], title, systems)


def save(figure: Figure, path: Path) -> None:
    """Writes a picture.

    Raises:
        CommandError: it cannot be written.
    """
    try:
        figure.savefig(path)
    except OSError as error:
        raise CommandError(f"cannot write {path}: {error.strerror}") from None


def _figure(title: str, size: tuple[float, float]) -> Figure:
    figure = Figure(figsize=size, dpi=120, layout="constrained", facecolor="white")
    figure.suptitle(title, fontsize=13, fontweight="bold")
    return figure


def _percent(part: float) -> str:
    return f"{100 * part:.1f} %"


def _metres(metres: float) -> str:
    return f"{metres / 1e3:.1f} km" if metres >= 1e3 else f"{metres:.0f} m"


def _span(distance: Array) -> tuple[float, float]:
    """The path's ends with a little room."""
    first, last = (float(distance[0]), float(distance[-1])) if len(distance) else (0.0, 1.0)
    room = max(0.01 * (last - first), 0.1)
    return first - room, last + room
