"""``vtr ps``."""

from pathlib import Path
from typing import TYPE_CHECKING

from cli.arguments import ConfigOption, JsonOption

if TYPE_CHECKING:
    from cli.views.processes import Row


def ps(*, config: ConfigOption = None, as_json: JsonOption = False) -> None:
    """Show a robot's processes: state, pid, restarts, rates, CPU and memory."""
    from cli import robot

    show(robot.find(config), as_json=as_json)


def show(config: Path, *, as_json: bool) -> None:
    """Show the processes of a robot, or of the fleet's server."""
    from cli.output import emit, table
    from cli.supervision.supervised import Supervised
    from cli.views.processes import rows

    supervised = Supervised(config)
    found = rows(supervised.config, supervised.table, supervised.processes())
    columns = ("process", "state", "pid", "restarts", "up s", "CPU %", "memory MB", "dropped", "rates Hz")
    emit(
        {"robot": supervised.config.robot.name, "processes": [row.json() for row in found]},
        table("", columns, [_cells(row) for row in found]),
        as_json=as_json,
    )


def _cells(row: "Row") -> tuple[object, ...]:
    cpu = "" if row.cpu is None else f"{row.cpu * 100:.0f}"
    memory = "" if row.memory_mb is None else f"{row.memory_mb:.0f}"
    uptime = "" if row.uptime_s is None else f"{row.uptime_s:.0f}"
    rates = ", ".join(
        f"{key} {rate:.3g}" for key, rate in sorted(row.rates_hz.items()) if rate > 0 and not key.startswith("health/")
    )
    return row.name, row.state.lower(), row.pid, row.restarts, uptime, cpu, memory, row.dropped, rates
