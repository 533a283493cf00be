"""The evaluation's report: figures as JSON, Table I in Markdown and for a reader, and Figures 7 to 9."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from cli import output
from cli.leave_one_out.results import BASELINE, COMBINED, EXPERIENCED, Results
from cli.views.localization_plots import MARK_M, Row, plot_dead_reckoning, plot_one_vs_all, plot_one_vs_one
from cli.views.offline import write
from services.estimator.coverage import failure_reduction

if TYPE_CHECKING:
    from rich.console import RenderableType

_TITLES = {BASELINE: "baseline", COMBINED: "combined", EXPERIENCED: "with experiences"}


def figures(results: Results) -> dict[str, Any]:
    """All figures, as plain numbers; metres, degrees, and parts of one."""
    drives, systems, reduction = range(len(results.times)), results.systems, results.failure_reduction()
    return {
        "drives": [
            {
                "time": results.times[drive].isoformat(timespec="minutes"),
                "sun_elevation_deg": round(results.elevations[drive], 1),
                "frames": len(results.of_live(drive)[0].distance),
                "coverage": {system: round(results.coverage(drive, system), 5) for system in systems},
                "against": {
                    results.name(one.taught): {s: round(one.coverage(s).fraction, 5) for s in systems}
                    for one in results.of_live(drive)
                },
            }
            for drive in drives
        ],
        "average": {system: round(results.average(system), 5) for system in systems},
        "failures_cut_by": None if reduction is None else round(reduction, 4),
        "systems": {system: _system(results, system) for system in systems},
    }


def _system(results: Results, system: str) -> dict[str, Any]:
    """One system over all drives."""
    coverage, errors = results.overall(system), results.position_errors(system)
    return {
        "driven_m": round(coverage.metres, 1),
        "losses": len(coverage.dropouts),
        "longest_loss_m": round(float(coverage.dropouts.max(initial=0.0)), 2),
        "probability_beyond_10_m": round(coverage.beyond(MARK_M), 5),
        "losses_beyond_10_m_per_km": round(coverage.per_kilometre(MARK_M), 4),
        "wrong_localizations": results.wrong(system),
        "position_error_m": {
            name: round(float(np.percentile(errors, part)), 4) if len(errors) else None
            for name, part in (("median", 50), ("p95", 95), ("max", 100))
        },
    }


def columns(report: dict[str, Any]) -> list[str]:
    """The table's head."""
    names = [_TITLES[system] for system in report["average"]]
    return ["repeated at (UTC)", "sun's elevation", *names[:2], "failures cut by", *names[2:]]


def rows(report: dict[str, Any]) -> list[list[str]]:
    """The table's rows as text: a drive each, then the average."""
    table = [
        [
            drive["time"].partition("T")[2].partition("+")[0],
            f"{drive['sun_elevation_deg']:.0f}°",
            *_shares(drive["coverage"]),
        ]
        for drive in report["drives"]
    ]
    return [*table, ["average", "", *_shares(report["average"])]]


def _shares(coverage: dict[str, float]) -> list[str]:
    cut = failure_reduction(coverage[BASELINE], coverage[COMBINED])
    shares = [f"{100 * part:.2f} %" for part in coverage.values()]
    return [*shares[:2], "" if cut is None else f"{100 * cut:.0f} %", *shares[2:]]


def sentences(report: dict[str, Any]) -> list[str]:
    """What the table does not say: of each system, what its losses and its localizations were like."""
    return [_said(_TITLES[system], figures_of) for system, figures_of in report["systems"].items()]


def _said(title: str, system: dict[str, Any]) -> str:
    error, wrong = system["position_error_m"], system["wrong_localizations"]
    losses = "1 loss" if system["losses"] == 1 else f"{system['losses']} losses"
    said = (
        f"{title.capitalize()}: {losses} of localization in {system['driven_m'] / 1e3:.1f} km, "
        f"{100 * system['probability_beyond_10_m']:.1f} % of them for more than {MARK_M:.0f} m, the longest for "
        f"{system['longest_loss_m']:.1f} m"
    )
    if error["median"] is None:
        return f"{said}."
    return (
        f"{said}; localized frames are off by {100 * error['median']:.1f} cm (median), {100 * error['p95']:.1f} cm "
        f"(95 %), {100 * error['max']:.1f} cm (most), {wrong or 'none'} by more than 0.5 m or 5°."
    )


def markdown(report: dict[str, Any]) -> str:
    """Table I and what it does not say."""
    head = columns(report)
    lines = ["| " + " | ".join(row) + " |" for row in (head, *rows(report))]
    lines.insert(1, "|---" * len(head) + "|")
    return "\n".join([*lines, "", "\n\n".join(sentences(report))]) + "\n"


def for_reader(report: dict[str, Any]) -> RenderableType:
    """The same on a terminal."""
    from rich.console import Group

    table = output.table("Coverage, each drive localized on every other", columns(report), rows(report))
    return Group(table, *sentences(report))


def save(results: Results, report: dict[str, Any], folder: Path) -> list[Path]:
    """Writes ``report.json``, ``table.md`` and the pictures of Figures 7 to 9; what was written."""
    files = [folder / name for name in ("report.json", "table.md", "one_vs_one.png", "one_vs_all.png")]
    write(files[0], json.dumps(report, indent=2) + "\n")
    write(files[1], markdown(report))
    pair, live = results.most_helped(), results.hardest_live()
    plot_one_vs_one(
        files[2],
        f"Taught at {results.name(pair.taught)}, repeated at {results.name(pair.live)} UTC",
        pair.distance,
        {"baseline": pair.success(BASELINE), "invariant": pair.invariant, "combined": pair.success(COMBINED)},
    )
    against = results.of_live(live)
    plot_one_vs_all(
        files[3],
        f"Repeated at {results.name(live)} UTC, on what was taught at every other time",
        against[0].distance,
        [Row(results.name(one.taught), one.success(BASELINE), one.invariant) for one in against],
    )
    plot_dead_reckoning(
        folder / "dead_reckoning.png",
        f"Dead reckoning after a loss of localization, {len(results.localized)} repeats",
        {_TITLES[system]: results.overall(system) for system in results.systems},
    )
    return [*files, folder / "dead_reckoning.png"]
