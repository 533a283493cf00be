"""The robot's processes: who is there, how they are, and when they were last heard of."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from typing import Any

from common.messages import Health

PROCESSES = ("router", "mapstore", "sensors", "estimator", "planner", "tracker", "safety", "navigator", "console")
"""Of every robot, in the order of the display."""

SILENT_S = 3.0
"""Health comes once a second: a process that is present and silent for longer hangs."""


@dataclass(slots=True)
class Processes:
    """What is known of each process by name; times are monotonic, in seconds."""

    health: dict[str, Health] = field(default_factory=dict)
    heard: dict[str, float] = field(default_factory=dict)

    def take(self, health: Health, arrival: float) -> None:
        """A process's own report."""
        self.health[health.process] = health
        self.hear(health.process, arrival)

    def hear(self, process: str, arrival: float) -> None:
        """Any message of a process."""
        self.heard[process] = max(arrival, self.heard.get(process, arrival))

    def rows(self, present: Collection[str], extra: Collection[str] = ()) -> Mapping[str, dict[str, Any]]:
        """A row for each process of the robot, and for the others that are there."""
        names = [*PROCESSES, *extra, *sorted(set(present) - {*PROCESSES, *extra})]
        return {name: self._row(name, name in present) for name in dict.fromkeys(names)}

    def _row(self, name: str, present: bool) -> dict[str, Any]:  # noqa: FBT001, a column
        heard, health = self.heard.get(name), self.health.get(name)
        row: dict[str, Any] = {"present": present, "heard": None if heard is None else round(heard, 1)}
        if health is not None:
            row |= {
                "pid": health.pid,
                "started": health.started // 1_000_000,
                "cpu": round(health.cpu, 2),
                "memory": round(health.memory_mb),
                "dropped": sum(health.dropped.values()),
                "rates": {key: round(rate, 1) for key, rate in sorted(health.rates.items()) if rate > 0},
                "stages": {key: [round(stage.p50, 1), round(stage.p99, 1)] for key, stage in health.stages.items()},
            }
        return row
