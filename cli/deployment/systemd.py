"""systemd's units of a robot, or of the fleet's server: a template, its limits for each process, and a target.

Each process is a service of its own, so that systemd alone starts it, watches it, bounds it and starts it anew; no
order is given, for the processes wait for each other.
"""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from cli.errors import CommandError
from cli.processes import BUSY, NEVER, Process
from common.config import RobotConfig

STATE = Path("/var/lib/retraverse")
"""What ``%S/retraverse`` is to the machine's systemd, and who runs the processes has as a home."""

LOG_NAMESPACE = "retraverse"

_STOP_S = 5
"""More than the 2 s that a process takes at most: systemd's own SIGKILL is for one that cannot end itself."""
_RESTART_S = 1
_MEMORY_MARGIN = 2.0
"""A budget is what driving takes; the limit is where a leak ends, before it takes the memory of others."""
_TASKS = 256

_FIRST, _REST, _LAST = 500, 100, 50
"""Shares of the processor where there is not enough: the robot's reflexes, its work, and what nothing waits for."""


@dataclass(frozen=True, slots=True)
class Installation:
    """Where things are on the machine that the units are for.

    Attributes:
        python: the interpreter of the environment that Retraverse is installed in.
        configuration: the TOML file as it is found there.
        user: who runs the processes.
    """

    python: Path
    configuration: Path
    user: str = "retraverse"


def units(
    configuration: RobotConfig, table: Sequence[Process], more: Sequence[Process], at: Installation
) -> dict[str, str]:
    """The text of each file below ``/etc/systemd/system``, by its path there.

    ``table`` is started with the target; ``more`` are processes that the template can run besides, once they are
    enabled by name.

    Raises:
        CommandError: a path or the user's name cannot stand in a unit.
    """
    kind = "fleet" if configuration.of_fleet else "robot"
    _require_plain(at)
    files = {
        f"retraverse-{kind}@.service": _template(kind, configuration, at),
        f"retraverse-{kind}.target": _target(kind, table),
    }
    for process in (*table, *more):
        files[f"{_unit(kind, process)}.d/limits.conf"] = _limits(process)
    return files


def _unit(kind: str, process: Process) -> str:
    return f"retraverse-{kind}@{process.name}.service"


def _target(kind: str, table: Sequence[Process]) -> str:
    what = "the fleet's server" if kind == "fleet" else "the robot"
    wants = "".join(f"Wants={_unit(kind, process)}\n" for process in table)
    return f"""\
[Unit]
Description=Retraverse: {what}
Documentation=man:systemd.target(5)
{wants}
[Install]
WantedBy=multi-user.target
"""


def _template(kind: str, configuration: RobotConfig, at: Installation) -> str:
    return f"""\
[Unit]
Description=Retraverse {kind}: %i
PartOf=retraverse-{kind}.target
# It is tried for as long as the machine runs: what it needs may come back at any time.
StartLimitIntervalSec=0

[Service]
Type=notify
NotifyAccess=main
ExecStart={at.python} -P -m services.%i --config {at.configuration}
User={at.user}
WorkingDirectory=%S/retraverse
Environment=HOME=%S/retraverse PYTHONUNBUFFERED=1 OPENBLAS_NUM_THREADS=1 OMP_NUM_THREADS=1
Environment=NUMBA_CACHE_DIR=%C/retraverse
Restart=always
RestartSec={_RESTART_S}
KillSignal=SIGTERM
TimeoutStopSec={_STOP_S}
# One that hangs leaves the traces of its threads in the log.
WatchdogSignal=SIGABRT
LimitCORE=0
LimitNOFILE=65536
TasksMax={_TASKS}
LogNamespace={LOG_NAMESPACE}
StateDirectory=retraverse
StateDirectoryMode=0750
CacheDirectory=retraverse
{_rights(configuration, at)}"""


def _rights(configuration: RobotConfig, at: Installation) -> str:
    """What a process may not do; it writes to its own folders alone. /dev/shm stays, frames travel through it."""
    directory = configuration.robot.directory
    own = not directory.is_absolute() and str(directory).startswith("~")
    folder = directory if directory.is_absolute() else at.configuration.parent / directory
    elsewhere = "" if own or folder.is_relative_to(STATE) else f"ReadWritePaths={shlex.quote(str(folder))}\n"
    home = "" if elsewhere and folder.is_relative_to("/home") else "ProtectHome=yes\n"
    return f"""\
NoNewPrivileges=yes
ProtectSystem=strict
{elsewhere}{home}ProtectKernelTunables=yes
ProtectKernelModules=yes
ProtectControlGroups=yes
RestrictSUIDSGID=yes
RestrictNamespaces=yes
LockPersonality=yes
RestrictAddressFamilies=AF_UNIX AF_INET AF_INET6 AF_NETLINK
CapabilityBoundingSet=
UMask=0027
"""


def _limits(process: Process) -> str:
    """The limits that follow from a row's budgets."""
    return f"""\
# From the table of processes: {process.cpu:.2f} of a core and {process.memory_mb:.0f} MB.
[Service]
TimeoutStartSec={process.start_deadline_s:g}
WatchdogSec={process.watchdog_s:g}
MemoryMax={round(process.memory_mb * _MEMORY_MARGIN)}M
MemorySwapMax=0
CPUWeight={_weight(process)}
CPUQuota={100 + round(100 * process.cpu)}%
OOMScoreAdjust={-500 if process.critical >= BUSY else 0}
"""


def _weight(process: Process) -> int:
    if process.critical >= BUSY:
        return _FIRST
    return _LAST if process.critical == NEVER and process.name == "fleet" else _REST


def _require_plain(at: Installation) -> None:
    """Refuses what systemd would take apart: it splits a command at spaces and expands ``%`` and ``$`` in it."""
    for text in (str(at.python), str(at.configuration), at.user):
        if any(character in text for character in " \t\n%$\"'\\;"):
            raise CommandError(f"'{text}' cannot stand in a unit of systemd: choose a name without spaces and signs")
    if not (at.python.is_absolute() and at.configuration.is_absolute()):
        raise CommandError("a unit names the interpreter and the configuration by their whole paths")
