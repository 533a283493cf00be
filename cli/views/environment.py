"""What the sub-commands of ``vtr env`` print."""

from __future__ import annotations

from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any

import numpy as np

from cli.output import table
from common.environment import Costs, MapTable
from services.fleet.similarity import SimilarityMatrix
from services.fleet.spectrum import Spectrum

if TYPE_CHECKING:
    from rich.console import RenderableType

_WIDEST = 16
"""Most maps whose similarities are printed as a table."""


def cost_figures(maps: MapTable, costs: Costs, at: float) -> dict[str, Any]:
    """Every map's costs at a time, hours since the Unix epoch, in the file's order."""
    columns = (maps.names, *(part.tolist() for part in (costs.similarity, costs.distance, costs.drift, costs.cost)))
    keys = ("name", "similarity_cost", "distance_cost", "drift_cost", "cost")
    rows = [dict(zip(keys, row, strict=True)) for row in zip(*columns, strict=True)]
    return {"at": datetime.fromtimestamp(round(at * 3600.0, 6), UTC).isoformat(), "maps": rows}


def cost_rows(maps: MapTable, costs: Costs) -> list[tuple[object, ...]]:
    """The same for a reader, cheapest first."""
    return [
        (
            maps.names[k],
            maps.places[int(maps.start[k])],
            maps.places[int(maps.end[k])],
            *(f"{part[k]:.3f}" for part in (costs.similarity, costs.distance, costs.drift, costs.cost)),
        )
        for k in np.argsort(costs.cost, kind="stable").tolist()
    ]


def spectrum_figures(found: Spectrum) -> dict[str, Any]:
    """The rhythms, strongest first, as the model of an environment takes them, and the reason."""
    return {
        "periods_hours": found.periods_hours.tolist(),
        "weights": found.weights.tolist(),
        "phases": found.phases.tolist(),
        "significance": found.significance.tolist(),
        "trend_per_hour": found.trend_per_hour,
        "reason": found.reason,
    }


def spectrum_text(found: Spectrum) -> RenderableType:
    """The same for a reader."""
    from rich.console import Group

    columns = (found.periods_hours, found.weights, found.phases, found.significance)
    rows = [
        (f"{period:.5g}", f"{weight:.3f}", f"{phase:+.3f}", "< 1e-12" if chance < 1e-12 else f"{chance:.2g}")
        for period, weight, phase, chance in zip(*columns, strict=True)
    ]
    lines = [found.reason]
    if found.trend_per_hour:
        lines.append(f"trend {found.trend_per_hour:.3g} per hour")
    if not rows:
        return "\n".join(lines)
    return Group(table("", ("period h", "weight", "phase", "by chance"), rows), *lines)


def matrix_text(matrix: SimilarityMatrix) -> RenderableType:
    """The matrix for a reader, if it is small."""
    if len(matrix.names) > _WIDEST:
        return f"{len(matrix.names)} maps compared; write them with --output, or print them with --json"
    rows = [(name, *(f"{value:.3f}" for value in row)) for name, row in zip(matrix.names, matrix.values, strict=True)]
    return table("", ("", *(str(k) for k in range(len(rows)))), rows)
