"""The figures of many runs: for each fault, and each kind of faults, the times to stop, the hold and the recovery."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any

import numpy as np
from rich.table import Table

from cli.chaos.judge import Outcome
from cli.errors import CommandError


def summary(outcomes: Sequence[Outcome]) -> dict[str, Any]:
    """All runs, and for each fault how they went."""
    faults = list(dict.fromkeys((o.fault, o.doing) for o in outcomes))
    kinds = sorted({kind_of(o.fault) for o in outcomes})
    return {
        "runs": len(outcomes),
        "passed": sum(o.passed for o in outcomes),
        "resumed_by_operator": sum(o.resumed for o in outcomes),
        "kinds": [_kind(kind, [o for o in outcomes if kind_of(o.fault) == kind]) for kind in kinds],
        "faults": [_row([o for o in outcomes if (o.fault, o.doing) == fault]) for fault in faults],
        "outcomes": [one(outcome) for outcome in outcomes],
    }


def kind_of(fault: str) -> str:
    """What was done, whatever it was done to: the first word of a fault's name."""
    return fault.split(maxsplit=1)[0]


def read(file: Path) -> list[Outcome]:
    """The outcomes of earlier runs, as :func:`one` wrote them line by line; none where there is no file.

    Raises:
        CommandError: the file holds something else.
    """
    if not file.is_file():
        return []
    try:
        return [_outcome(json.loads(line)) for line in file.read_text(encoding="utf-8").splitlines()]
    except (ValueError, TypeError, AttributeError):
        raise CommandError(f"{file} is no report of faults of this version: move it, or give another folder") from None


def one(outcome: Outcome) -> dict[str, Any]:
    """A run's outcome, as JSON holds it."""
    return _jsonable(asdict(outcome))


def table(data: dict[str, Any]) -> Table:
    """The faults as a table for a terminal."""
    times = "stops", "zero command", "wheels brake", "standstill"
    shown = Table("fault", "in", "runs", "passed", *times, "hold", "moving again", "off path", "")
    for row in data["faults"]:
        shown.add_row(
            row["fault"],
            row["doing"],
            str(row["runs"]),
            str(row["passed"]),
            *(_seconds(row[key]) for key in ("stops_p99_s", "zero_command_p99_s", "brakes_p99_s", "standstill_p99_s")),
            "" if row["hold"] is None else f"{row['hold']:.1%}",
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
            "brakes_p99_s": _p99([o.brakes_s for o in outcomes]),
            "standstill_p99_s": _p99([o.standstill_s for o in outcomes]),
            "hold": _hold(outcomes),
            "moving_p99_s": _p99([o.moving_s for o in outcomes]),
            "resumed_by_operator": sum(o.resumed for o in outcomes),
            "offset_max_m": max(o.offset_m for o in outcomes),
            "why": next((o.why for o in outcomes if o.why), ""),
        }
    )


def _outcome(row: dict[str, Any]) -> Outcome:
    numbers = {field.name for field in fields(Outcome) if field.type == "float"}
    known: dict[str, Any] = {key: math.nan if key in numbers and value is None else value for key, value in row.items()}
    return Outcome(**known)


def _kind(kind: str, outcomes: Sequence[Outcome]) -> dict[str, Any]:
    """All faults of a kind; how late a stop began is beyond the age limit of the input that failed.

    It begins in ``command/safe``, or at the wheels of a base that hears nothing more.
    """
    late = [o.stops_s - o.limit_s for o in outcomes]
    by_itself = [o.brakes_s - o.limit_s for o in outcomes if math.isnan(o.stops_s)]
    moving = [o.moving_s for o in outcomes if not o.resumed]
    return _jsonable(
        {
            "kind": kind,
            "runs": len(outcomes),
            "passed": sum(o.passed for o in outcomes),
            "late_p99_s": _p99(late),
            "base_late_p99_s": _p99(by_itself),
            "standstill_p99_s": _p99([o.standstill_s for o in outcomes]),
            "hold": _hold(outcomes),
            "moving_p99_s": _p99(moving),
            "resumed_by_operator": sum(o.resumed for o in outcomes),
            "offset_max_m": max(o.offset_m for o in outcomes),
        }
    )


def _hold(outcomes: Sequence[Outcome]) -> float:
    """The mean share over the runs that had to stop, NaN without one: others may drive on whenever they can."""
    stopped = [o.hold for o in outcomes if math.isfinite(o.limit_s)]
    return float(np.mean(stopped)) if stopped else float("nan")


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
