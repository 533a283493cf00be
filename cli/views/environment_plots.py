"""Pictures of an environment: what its maps cost over a day, the graph with a plan, and the spectrum of its rhythms."""

from __future__ import annotations

import math
import textwrap
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import FancyArrowPatch

from cli.views.localization_plots import save
from common.environment import MapTable, Model, Plan, Theta, map_costs
from common.environment.layout import places_in_plane
from services.fleet.spectrum import Spectrum

_CHOSEN, _OTHER, _LEVEL = "#c8553d", "#9aa3ad", "#2f6db3"
_LEGEND, _DRAWN, _LABELLED = 12, 400, 60
"""Most maps in the legend, most lines or arrows, and most places with a name in a picture."""
_TICKS = (3, 6, 12, 24, 48, 84, 168, 336, 730, 2191, 8766)


def plot_costs(
    path: Path, title: str, maps: MapTable, model: Model, at: float, theta: Theta, *, per_metre: bool
) -> None:
    """The cost of each map over the day about ``at``, hours since the Unix epoch."""
    figure = _figure(title, (10, 5.4))
    axes = figure.add_subplot()
    hours = at + np.linspace(-12.0, 12.0, 289)
    costs = np.array([map_costs(maps, model, float(hour), theta, per_metre=per_metre).cost for hour in hours])
    now = len(hours) // 2
    cheapest = np.argsort(costs[now], kind="stable") if len(maps) else np.empty(0, dtype=np.int64)
    colours = colormaps["turbo"](np.linspace(0.05, 0.95, max(1, min(len(maps), _LEGEND))))
    for rank, k in enumerate(cheapest[:_DRAWN].tolist()):
        named = rank < _LEGEND
        style = {"color": colours[rank], "label": maps.names[k]} if named else {"color": "0.8", "zorder": 0}
        axes.plot(hours - at, costs[:, k], linewidth=1.8 if named else 0.7, **style)
    axes.axvline(0.0, color="0.4", linewidth=1.0, linestyle=":")
    ticks = np.arange(math.ceil((at - 12.0) / 3.0), math.floor((at + 12.0) / 3.0) + 1) * 3.0
    axes.set_xticks(ticks - at, [f"{hour % 24.0:02.0f}:00" for hour in ticks.tolist()])
    axes.set_xlim(-12.0, 12.0)
    moment = datetime.fromtimestamp(at * 3600.0, UTC)
    axes.set_xlabel(f"time of the drive, UTC ({moment:%Y-%m-%d %H:%M} dotted)")
    axes.set_ylabel("cost J")
    axes.grid(alpha=0.25)
    if len(maps):
        heading = "cheapest then, first" if len(maps) > 1 else None
        axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), frameon=False, fontsize=9, title=heading)
    save(figure, path)


def plot_plan(path: Path, title: str, maps: MapTable, plan: Plan) -> None:
    """The places and maps, with the chosen ones thick; places stand where springs of the maps' lengths put them."""
    figure = _figure(title, (9.5, 6.2))
    axes = figure.add_subplot()
    chosen = set(plan.edges)
    shown = sorted(chosen) + [k for k in range(len(maps)) if k not in chosen][: max(0, _DRAWN - len(chosen))]
    used = sorted({int(place) for k in shown for place in (maps.start[k], maps.end[k])})
    points = places_in_plane(maps, np.array(used), np.array(shown))
    at = {place: (float(x), float(y)) for place, (x, y) in zip(used, points, strict=True)}
    drawn: dict[tuple[int, int], int] = {}
    for k in shown:
        ends = int(maps.start[k]), int(maps.end[k])
        drawn[ends] = drawn.get(ends, 0) + 1
        _arrow(axes, at[ends[0]], at[ends[1]], 0.12 + 0.13 * (drawn[ends] - 1), k in chosen)
        if k in chosen or len(shown) <= _LABELLED // 2:
            label = f"{maps.names[k]}\n{plan.costs.edge[k]:.3f}"
            _label(axes, at[ends[0]], at[ends[1]], 0.12 + 0.13 * (drawn[ends] - 1), label, k in chosen)
    on_route = {int(maps.start[plan.edges[0]]), *(int(maps.end[k]) for k in plan.edges)}
    for place in used:
        colour = _CHOSEN if place in on_route else "white"
        axes.plot(*at[place], "o", markersize=20 if len(used) <= _LABELLED else 5, color=colour, markeredgecolor="0.3")
        if len(used) <= _LABELLED:
            text = maps.places[place]
            axes.annotate(
                text, at[place], ha="center", va="center", fontsize=9, color="white" if place in on_route else "0.2"
            )
    missing = len(maps) - len(shown)
    axes.set_title(f"cost {plan.cost:.3f}" + (f"; {missing} more maps" if missing else ""), loc="left", fontsize=10.5)
    axes.set_aspect("equal")
    axes.margins(0.12)
    axes.axis("off")
    save(figure, path)


def plot_spectrum(path: Path, title: str, spectrum: Spectrum) -> None:
    """The power of each period, the levels that noise reaches by chance, and the periods that are claimed."""
    figure = _figure(title, (10, 5.2))
    axes = figure.add_subplot()
    if len(spectrum.frequencies):
        periods = 1.0 / spectrum.frequencies
        axes.semilogx(periods, spectrum.power, color="0.35", linewidth=1.0)
        axes.set_xlim(periods[-1], periods[0])
        ticks = [tick for tick in _TICKS if periods[-1] <= tick <= periods[0]]
        axes.set_xticks(ticks, [f"{tick:g}" for tick in ticks], minor=False)
        axes.minorticks_off()
        top = float(spectrum.power.max())
        for (chance, level), style in zip(spectrum.levels.items(), ("-", "--", ":"), strict=False):
            label = f"by chance with probability {100 * chance:g} %"
            axes.axhline(level, color=_LEVEL, linewidth=1.0, linestyle=style, label=label)
        axes.legend(loc="upper right", fontsize=9, frameon=False)
        top = max(top, *spectrum.levels.values())
        for period in spectrum.periods_hours:
            height = float(np.interp(1.0 / period, spectrum.frequencies, spectrum.power))
            axes.plot(period, height, "v", color=_CHOSEN, markersize=9)
            axes.annotate(
                f"{period:.4g} h",
                (period, height),
                xytext=(0, 8),
                textcoords="offset points",
                ha="center",
                color=_CHOSEN,
                fontsize=10,
            )
        axes.set_ylim(0.0, 1.15 * max(top, 1e-3))
    axes.set_title(_wrapped(spectrum.reason), loc="left", fontsize=9.5, color="0.3")
    axes.set_xlabel("period [h]")
    axes.set_ylabel("part of the variance explained")
    axes.grid(alpha=0.25)
    save(figure, path)


def _arrow(axes: Axes, start: tuple[float, float], end: tuple[float, float], bend: float, chosen: bool) -> None:  # noqa: FBT001, a drawing's detail
    axes.add_patch(
        FancyArrowPatch(
            start,
            end,
            arrowstyle="-|>",
            mutation_scale=14,
            shrinkA=11,
            shrinkB=11,
            connectionstyle=f"arc3,rad={bend}",
            color=_CHOSEN if chosen else _OTHER,
            linewidth=2.6 if chosen else 1.0,
            zorder=2 if chosen else 1,
        )
    )


def _label(
    axes: Axes,
    start: tuple[float, float],
    end: tuple[float, float],
    bend: float,
    text: str,
    chosen: bool,  # noqa: FBT001
) -> None:
    (x, y), (u, v) = start, end
    place = (0.5 * (x + u) + 0.5 * bend * (v - y), 0.5 * (y + v) - 0.5 * bend * (u - x))
    axes.annotate(
        text,
        place,
        fontsize=8,
        ha="center",
        va="center",
        color=_CHOSEN if chosen else "0.45",
        zorder=3,
        bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.8, "pad": 0.6},
    )


def _figure(title: str, size: tuple[float, float]) -> Figure:
    figure = Figure(figsize=size, dpi=120, layout="constrained", facecolor="white")
    figure.suptitle(title, fontsize=13, fontweight="bold")
    return figure


def _wrapped(text: str) -> str:
    return "\n".join(textwrap.wrap(text, 125))
