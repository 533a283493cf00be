"""What came of a long drive."""

from __future__ import annotations

from typing import Any

import numpy as np
from rich.table import Table

from cli.soak.drive import Drive
from cli.soak.network import Network
from common.geometry import Array

_STEP_M = 0.05
_AT_ONCE = 256


def report(network: Network, seen: Drive, minutes: float, faults: list[str]) -> dict[str, Any]:
    """All figures; ``faults`` are what the walk over the graph has found."""
    offsets = offsets_from(network.paths, seen.followed())
    growth = {name: growth_of(rows) for name, rows in sorted(seen.memory.items())}
    return {
        "minutes": round(minutes, 1),
        "network_m": round(network.metres(), 1),
        "kilometres": round(seen.kilometres(), 3),
        "goals": seen.goals,
        "reached": seen.reached,
        "interventions": seen.interventions,
        "kills": dict(sorted(seen.kills.items())),
        "stops": dict(sorted(seen.stops.items())),
        "lateral_rms_m": round(float(np.sqrt(np.mean(offsets**2))), 4) if len(offsets) else None,
        "lateral_p99_m": round(float(np.percentile(offsets, 99)), 4) if len(offsets) else None,
        "lateral_max_m": round(float(offsets.max()), 4) if len(offsets) else None,
        "memory_growth": {name: round(value, 4) for name, value in growth.items()},
        "graph": faults,
    }


def growth_of(rows: list[tuple[float, int]]) -> float:
    """By what part the most that a process took in the second half of the time is more than that in the first.

    ``rows`` are seconds since the beginning and bytes. What is kept within bounds is full in the first half already.
    """
    middle = rows[-1][0] / 2.0
    first, second = (max((size for t, size in rows if (t > middle) is late), default=0) for late in (False, True))
    return second / first - 1.0 if first else 0.0


def offsets_from(paths: list[Array], places: Array) -> Array:
    """How far each place (N, 2) is from the nearest of some polylines, metres (N,)."""
    segments = [np.stack([path[:-1], path[1:]], axis=1) for path in map(_thinned, paths)]
    ends = np.concatenate(segments)
    a, along = ends[:, 0], ends[:, 1] - ends[:, 0]
    squared = (along**2).sum(axis=1)
    nearest = np.empty(len(places))
    for k in range(0, len(places), _AT_ONCE):
        offset = places[k : k + _AT_ONCE, None, :] - a
        t = np.clip((offset * along).sum(axis=2) / squared, 0.0, 1.0)
        nearest[k : k + _AT_ONCE] = np.linalg.norm(offset - t[:, :, None] * along, axis=2).min(axis=1)
    return nearest


def _thinned(path: Array) -> Array:
    """Some points of a path, a few centimetres apart."""
    driven = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))])
    _, kept = np.unique(np.floor(driven / _STEP_M), return_index=True)
    return path[kept]


def table(data: dict[str, Any]) -> Table:
    """The figures for a terminal."""
    shown = Table("", "", show_header=False)
    for key, value in data.items():
        text = "\n".join(map(str, value)) if isinstance(value, list) else str(value)
        if isinstance(value, dict):
            text = ", ".join(f"{name} {count}" for name, count in value.items())
        shown.add_row(key.replace("_", " "), text or "none")
    return shown
