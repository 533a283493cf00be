"""The processes of a robot, as one table: ``vtr up`` starts it, ``vtr ps`` shows it, tests hold it to its budgets."""

from __future__ import annotations

from dataclasses import dataclass

from common.config import RobotConfig
from common.messages import StateName


@dataclass(frozen=True, slots=True)
class Process:
    """One row of the table.

    Attributes:
        name: the process, its table in the robot's TOML file, and its name on the bus.
        module: what ``python -m`` runs.
        when: why the process is there; every process of the present table runs whenever its robot does.
        critical: the states in which the robot stops without it.
        start_deadline_s: it is present on the bus this long after its start, or the start has failed.
        cpu: budget as a fraction of one core, averaged over a minute of driving.
        memory_mb: budget of its resident memory, 10^6 bytes.
        watchdog_s: without a sign of life for so long it hangs: its work holds still, or cannot even be looked at.
        under: a module that runs ``module`` in its place, as the fault tests need it.
    """

    name: str
    module: str
    when: str
    critical: frozenset[StateName]
    start_deadline_s: float
    cpu: float
    memory_mb: float
    watchdog_s: float = 30.0
    under: str = ""

    @property
    def run(self) -> str:
        """What follows ``python -m``."""
        return f"{self.under} {self.module}".lstrip()


NEVER: frozenset[StateName] = frozenset()
FOLLOWING = frozenset({StateName.REPEAT_FOLLOW})
PLANNING = frozenset({StateName.REPEAT_PLAN})
LOCALIZING = frozenset({StateName.TEACH_METRIC_LOCALIZE, StateName.REPEAT_METRIC_LOCALIZE})
TEACHING = frozenset({StateName.TEACH_BRANCH, StateName.TEACH_MERGE})
SEEING = TEACHING | LOCALIZING | FOLLOWING
BUSY = SEEING | PLANNING

ROBOT: tuple[Process, ...] = (
    Process("router", "services.router", "always", BUSY, 60, 0.10, 300),
    Process("mapstore", "services.mapstore", "always", TEACHING | LOCALIZING | PLANNING, 60, 0.10, 400),
    Process("sensors", "services.sensors", "always", SEEING, 120, 0.60, 900),
    Process("estimator", "services.estimator", "always", SEEING, 120, 0.80, 900),
    Process("planner", "services.planner", "always", PLANNING, 120, 0.05, 400),
    Process("tracker", "services.tracker", "always", FOLLOWING, 120, 0.15, 400),
    Process("safety", "services.safety", "always", BUSY, 60, 0.10, 250, watchdog_s=5),
    Process("navigator", "services.navigator", "always", BUSY, 60, 0.05, 250),
    Process("console", "services.console", "always", NEVER, 60, 0.05, 300),
)
"""What runs on a robot; the order is that of the display, for any process may start before any other."""


OPTIONAL: tuple[Process, ...] = (
    Process("obstacles", "services.obstacles", "where the file has a table [obstacles]", FOLLOWING, 60, 0.25, 300),
)
"""What runs on a robot whose file asks for it."""

FLEET: tuple[Process, ...] = (
    Process("router", "services.router", "always", NEVER, 60, 0.10, 300),
    Process("storage", "services.storage", "where no other storage is configured", NEVER, 60, 0.20, 600),
    Process("fleet", "services.fleet", "always", NEVER, 120, 1.00, 2000),
    Process("console", "services.console", "always", NEVER, 60, 0.10, 300),
)
"""What runs on the fleet's server."""


def table_of(configuration: RobotConfig) -> tuple[Process, ...]:
    """The processes that a configuration is of; the storage is none of them where another one is named."""
    if not configuration.of_fleet:
        return (*ROBOT, *(process for process in OPTIONAL if process.name in configuration.tables))
    elsewhere = bool(configuration.tables.get("fleet", {}).get("endpoint"))
    return tuple(process for process in FLEET if not (elsewhere and process.name == "storage"))


def named(name: str) -> Process:
    """The row of a process.

    Raises:
        KeyError: there is no such process.
    """
    return {process.name: process for process in (*ROBOT, *OPTIONAL)}[name]
