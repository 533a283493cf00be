"""The demo's figures: computed from what was recorded on the bus, written as JSON, printed as a table."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from cli.daylight import Times
from cli.demo.errors import path_errors, settling_distance
from cli.demo.recorder import Recording

SETTLING_M = 5.0
"""Errors count from here on: the robot starts 0.3 m beside the path on purpose."""


@dataclass(frozen=True, slots=True)
class Shared:
    """How a map came from the robot that taught it to one that had none.

    Attributes:
        map: its id.
        teacher, learner: the two robots.
        megabytes: of the map in the teacher's store.
        shared_s: from the end of the teach until the map was in the fleet's storage, seconds.
        fetched_s: from the command to repeat until the learner followed the map, seconds.
        in_catalog: the fleet server's maps at the end, the learner's own drive among them.
    """

    map: str
    teacher: str
    learner: str
    megabytes: float
    shared_s: float
    fetched_s: float
    in_catalog: int


@dataclass(frozen=True, slots=True)
class Report:
    """What ``demo/report.json`` holds; see its keys."""

    teach_time: str
    repeat_time: str
    route_length_m: float
    duration_s: float
    mean_speed_m_s: float
    start_offset: dict[str, float]
    settling_distance_m: float
    errors_counted_from_m: float
    lateral_error_m: dict[str, float]
    heading_error_deg: dict[str, float]
    end_error_m: float
    localization: dict[str, float]
    streams: dict[str, float]
    latency_ms: dict[str, float]
    processes: dict[str, dict[str, float]]
    final_state: str
    final_reason: str
    shared: Shared | None = None


def make_report(
    taught: Recording, repeated: Recording, offset: dict[str, float], light: Times, shared: Shared | None = None
) -> Report:
    """The figures of a repeat against the teach that it follows."""
    errors = path_errors(taught.poses(), repeated.poses())
    settled = errors.after(SETTLING_M)
    driving = repeated.driving_seconds()
    length = float(errors.arclength.max())
    return Report(
        teach_time=light.teach.isoformat(timespec="minutes"),
        repeat_time=light.repeat.isoformat(timespec="minutes"),
        route_length_m=round(taught.driven_metres(), 2),
        duration_s=round(driving, 1),
        mean_speed_m_s=round(length / driving, 3),
        start_offset=offset,
        settling_distance_m=round(settling_distance(errors), 2),
        errors_counted_from_m=SETTLING_M,
        lateral_error_m=_spread(np.abs(settled.lateral), 4),
        heading_error_deg=_spread(np.degrees(np.abs(settled.heading)), 2),
        end_error_m=round(float(np.linalg.norm(taught.poses()[-1][:3, 3] - repeated.poses()[-1][:3, 3])), 3),
        localization=repeated.localization_figures(),
        streams=repeated.stream_shares(),
        latency_ms=repeated.latency_figures(),
        processes=repeated.process_figures(),
        final_state=repeated.final_state,
        final_reason=repeated.final_reason,
        shared=shared,
    )


def _spread(values: np.ndarray[Any, Any], digits: int) -> dict[str, float]:
    return {
        "rms": round(float(np.sqrt(np.mean(values**2))), digits),
        "p95": round(float(np.percentile(values, 95)), digits),
        "max": round(float(values.max()), digits),
    }


def clock_times(report: Report) -> str:
    """When it was taught and repeated, in words."""
    taught, repeated = (text.partition("T")[2].partition("+")[0] for text in (report.teach_time, report.repeat_time))
    return (
        f"Taught and repeated at {taught} UTC"
        if taught == repeated
        else f"Taught at {taught}, repeated at {repeated} UTC"
    )


def _shares(streams: dict[str, float]) -> str:
    return ", ".join(f"{name} {share:.1%}" for name, share in streams.items()) or "no stream"


def shared_text(shared: Shared) -> str:
    """How the map came from one robot to the other."""
    return (
        f"{shared.teacher} taught {shared.map} and shared its {shared.megabytes:.1f} MB in {shared.shared_s:.1f} s; "
        f"{shared.learner}, which had no map, drove off {shared.fetched_s:.1f} s after it was asked to"
    )


def write_report(report: Report, path: Path) -> None:
    """Writes the figures as JSON."""
    path.write_text(json.dumps(asdict(report), indent=2) + "\n", encoding="utf-8")


def print_report(report: Report, console: Console) -> None:
    """Prints the figures as tables."""
    console.print(clock_times(report))
    table = Table("", "RMS", "95 %", "max", title=f"Repeat of {report.route_length_m:.1f} m")
    for name, row, unit, scale in (
        ("lateral error", report.lateral_error_m, "cm", 100.0),
        ("heading error", report.heading_error_deg, "°", 1.0),
    ):
        table.add_row(name, *(f"{row[key] * scale:.1f} {unit}" for key in ("rms", "p95", "max")))
    console.print(table)
    console.print(
        f"mean speed {report.mean_speed_m_s:.2f} m/s · settled after {report.settling_distance_m:.1f} m from an offset "
        f"of {report.start_offset['lateral_m']:.1f} m and {report.start_offset['heading_deg']:.0f}° · "
        f"stopped {report.end_error_m * 100:.0f} cm from the taught end"
    )
    console.print(
        f"localization {report.localization['rate_hz']:.1f} Hz, {report.localization['success']:.1%} of frames "
        f"({_shares(report.streams)}) · "
        f"frame to command/safe {report.latency_ms['p50']:.0f} ms (p50), {report.latency_ms['p99']:.0f} ms (p99)"
    )
    processes = Table("process", "CPU", "memory", "main stage", "p50", "p99", title="Processes while repeating")
    for name, row in sorted(report.processes.items()):
        stage = f"{row['p50_ms']:.1f} ms", f"{row['p99_ms']:.1f} ms"
        shown = (str(row["stage"]), *stage) if row["stage"] else ("", "", "")
        processes.add_row(name, f"{row['cpu']:.0%}", f"{row['memory_mb']:.0f} MB", *shown)
    console.print(processes)
    if report.shared is not None:
        console.print(shared_text(report.shared))
    console.print(f"{report.final_state}: {report.final_reason}")
