"""What ``vtr ps`` shows: the supervisor's view of each process, joined with the health that it reports on the bus."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass

import psutil

from cli import client
from cli.processes import Process
from cli.supervision.client import ProcessState
from common import topics
from common.bus import Bus
from common.config import RobotConfig
from common.errors import NoRouter
from common.messages import Health, now_ns

_HEALTH_DEADLINE_S = 2.5
_POLL_S = 0.05


@dataclass(frozen=True, slots=True)
class Row:
    """A process in figures; ``None`` where neither the supervisor nor the process itself tells.

    ``state`` is the supervisor's; without one it is PRESENT or ABSENT, by the bus. ``cpu`` is a fraction of a core,
    ``rates_hz`` samples a second by topic without the robot's prefix, ``dropped`` those refused since the start.
    """

    name: str
    state: str
    pid: int | None
    restarts: int | None
    uptime_s: float | None
    cpu: float | None
    memory_mb: float | None
    rates_hz: dict[str, float]
    dropped: int

    def json(self) -> dict[str, object]:
        """The row as JSON holds it."""
        return asdict(self)


def rows(configuration: RobotConfig, table: Sequence[Process], states: Sequence[ProcessState]) -> list[Row]:
    """A row for each process of the table.

    Raises:
        NoRouter: neither a supervisor nor a router answers, so that nothing is known.
    """
    by_name = {state.name: state for state in states}
    try:
        with client.connect(configuration, timeout=1.5) as bus:
            present, health = _listen(bus, table)
    except NoRouter:
        if not states:
            raise
        present, health = frozenset(), {}
    prefix = f"vtr/{configuration.robot.name}/"
    return [_row(p.name, by_name.get(p.name), health.get(p.name), prefix, p.name in present) for p in table]


def _listen(bus: Bus, table: Sequence[Process]) -> tuple[frozenset[str], dict[str, Health]]:
    """Who is present, and the next health report of each, for as long as a report takes to come."""
    presence = bus.presence()
    subscriptions = {process.name: bus.subscribe(topics.HEALTH, process.name) for process in table}
    end = time.monotonic() + _HEALTH_DEADLINE_S
    heard: dict[str, Health] = {}
    while time.monotonic() < end and not (heard and presence.alive() <= heard.keys()):
        for name, subscription in subscriptions.items():
            if (received := subscription.poll()) is not None:
                heard[name] = received.message
        time.sleep(_POLL_S)
    return presence.alive(), heard


def _memory_mb(pid: int | None) -> float | None:
    """Resident memory of a process that does not report it itself."""
    if pid is None:
        return None
    try:
        return round(psutil.Process(pid).memory_info().rss / 1e6, 1)
    except psutil.Error:
        return None


def _row(name: str, state: ProcessState | None, health: Health | None, prefix: str, present: bool) -> Row:  # noqa: FBT001
    if state is not None and health is not None and health.pid != state.pid:
        health = None  # the last words of an earlier life
    uptime = state.uptime_s if state else (now_ns() - health.started) / 1e9 if health else None
    pid = state.pid if state else health.pid if health else None
    return Row(
        name=name,
        state=state.state if state else "PRESENT" if present else "ABSENT",
        pid=pid,
        restarts=state.restarts if state else None,
        uptime_s=None if uptime is None else round(uptime, 1),
        cpu=None if health is None else round(health.cpu, 3),
        memory_mb=_memory_mb(pid) if health is None else round(health.memory_mb, 1),
        rates_hz={} if health is None else {key.removeprefix(prefix): rate for key, rate in health.rates.items()},
        dropped=0 if health is None else sum(health.dropped.values()),
    )
