"""What the sub-commands of ``vtr env`` print."""

from __future__ import annotations

from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any

import numpy as np

from cli.output import table
from common.environment import Costs, MapTable, Model
from common.environment.costs import Array
from common.messages import EnvironmentModel
from services.fleet.similarity import SimilarityMatrix
from services.fleet.spectrum import Spectrum

if TYPE_CHECKING:
    from rich.console import RenderableType

_WIDEST = 16
"""Most maps whose similarities are printed as a table."""


def cost_figures(maps: MapTable, costs: Costs, at: float) -> dict[str, Any]:
    """Every map's costs at a time, hours since the Unix epoch, in the file's order."""
    parts = _parts(maps, costs)
    columns = (maps.names, *(values.tolist() for values in parts.values()))
    keys = ("name", *(key.replace(" ", "_") for key in parts))
    rows = [dict(zip(keys, row, strict=True)) for row in zip(*columns, strict=True)]
    return {"at": datetime.fromtimestamp(round(at * 3600.0, 6), UTC).isoformat(), "maps": rows}


def cost_rows(maps: MapTable, costs: Costs) -> list[tuple[object, ...]]:
    """The same for a reader, cheapest first."""
    return [
        (
            maps.names[k],
            maps.places[int(maps.start[k])],
            maps.places[int(maps.end[k])],
            *(f"{part[k]:.3f}" for part in _parts(maps, costs).values()),
        )
        for k in np.argsort(costs.cost, kind="stable").tolist()
    ]


def cost_columns(maps: MapTable) -> tuple[str, ...]:
    """The headings of these rows."""
    terms = ("similarity cost", "distance cost", "drift cost")
    return ("map", "from", "to", *terms, *(() if maps.trouble is None else ("trouble cost",)), "cost")


def _parts(maps: MapTable, costs: Costs) -> dict[str, Array]:
    """The terms of a cost and their sum, trouble among them only where somebody has reported any."""
    trouble = {} if maps.trouble is None else {"trouble cost": costs.trouble}
    terms = {"similarity cost": costs.similarity, "distance cost": costs.distance, "drift cost": costs.drift}
    return terms | trouble | {"cost": costs.cost}


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


def model_text(name: str, model: Model | EnvironmentModel) -> RenderableType:
    """A model as a table: a row for each rhythm; that of a fleet says what it was made of, and why it is no more."""
    told = isinstance(model, EnvironmentModel)
    significance = model.significance if isinstance(model, EnvironmentModel) else []
    rows = [
        (round(period, 3), round(weight, 4), round(phase, 4), f"{significance[k]:.2g}" if told else "")
        for k, (period, weight, phase) in enumerate(zip(model.periods_hours, model.weights, model.phases, strict=True))
    ]
    title = f"{name}: trend {model.trend_per_hour:.3g} per hour"
    if isinstance(model, EnvironmentModel):
        title = f"{title}, of {model.maps} maps; {model.reason}"
    return table(title, ("period h", "weight", "phase rad", "significance"), rows)
