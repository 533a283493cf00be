"""The figures of many runs: for each fault the times to stop, the hold and the recovery."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

import numpy as np
from rich.table import Table

from cli.chaos.judge import Outcome


def summary(outcomes: Sequence[Outcome]) -> dict[str, Any]:
    """All runs, and for each fault how they went."""
    kinds = list(dict.fromkeys((o.fault, o.doing) for o in outcomes))
    return {
        "runs": len(outcomes),
        "passed": sum(o.passed for o in outcomes),
        "resumed_by_operator": sum(o.resumed for o in outcomes),
        "faults": [_row([o for o in outcomes if (o.fault, o.doing) == kind]) for kind in kinds],
        "outcomes": [one(outcome) for outcome in outcomes],
    }


def one(outcome: Outcome) -> dict[str, Any]:
    """A run's outcome, as JSON holds it."""
    return _jsonable(asdict(outcome))


def table(data: dict[str, Any]) -> Table:
    """The faults as a table for a terminal."""
    times = "stops", "zero command", "standstill"
    shown = Table("fault", "in", "runs", "passed", *times, "hold", "moving again", "off path", "")
    for row in data["faults"]:
        shown.add_row(
            row["fault"],
            row["doing"],
            str(row["runs"]),
            str(row["passed"]),
            *(_seconds(row[key]) for key in ("stops_p99_s", "zero_command_p99_s", "standstill_p99_s")),
            f"{row['hold']:.1%}",
            _seconds(row["moving_p99_s"]),
            f"{row['offset_max_m'] * 100:.0f} cm",
            row["why"],
        )
    return shown


def _row(outcomes: Sequence[Outcome]) -> dict[str, Any]:
    return _jsonable(
        {
            "fault": outcomes[0].fault,
            "doing": outcomes[0].doing,
            "runs": len(outcomes),
            "passed": sum(o.passed for o in outcomes),
            "stops_p99_s": _p99([o.stops_s for o in outcomes]),
            "zero_command_p99_s": _p99([o.zero_command_s for o in outcomes]),
            "standstill_p99_s": _p99([o.standstill_s for o in outcomes]),
            "hold": float(np.mean([o.hold for o in outcomes])),
            "moving_p99_s": _p99([o.moving_s for o in outcomes]),
            "resumed_by_operator": sum(o.resumed for o in outcomes),
            "offset_max_m": max(o.offset_m for o in outcomes),
            "why": next((o.why for o in outcomes if o.why), ""),
        }
    )


def _p99(values: Sequence[float]) -> float:
    known = [value for value in values if np.isfinite(value)]
    return float(np.percentile(known, 99)) if known else float("nan")


def _jsonable(row: dict[str, Any]) -> dict[str, Any]:
    """Numbers that JSON has, to the millisecond and millimetre; null for what did not happen."""
    return {
        key: (round(value, 3) if np.isfinite(value) else None) if isinstance(value, float) else value
        for key, value in row.items()
    }


def _seconds(value: float | None) -> str:
    return "" if value is None else f"{value:.2f} s"
