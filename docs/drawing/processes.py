"""The table of processes."""

from __future__ import annotations

from cli.processes import FLEET, OPTIONAL, ROBOT, Process
from common.messages import StateName
from docs.drawing.markdown import table


def every() -> str:
    """One row a process of a robot."""
    head = ("process", "runs", "the robot stops without it in", "starts within", "CPU budget", "memory budget")
    return table(head, [_row(one) for one in (*ROBOT, *OPTIONAL)])


def of_fleet() -> str:
    """One row a process of the fleet's server."""
    head = ("process", "runs", "starts within", "CPU budget", "memory budget")
    return table(head, [(row := _row(one))[:2] + row[3:] for one in FLEET])


def _row(process: Process) -> tuple[str, ...]:
    states = ", ".join(f"`{state}`" for state in StateName if state in process.critical) or "no state"
    return (
        f"[{process.name}]({process.name}.md)",
        process.when,
        states,
        f"{process.start_deadline_s:g} s",
        f"{process.cpu:g} of a core",
        f"{process.memory_mb:g} MB",
    )
