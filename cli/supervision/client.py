"""Supervisor's XML-RPC over its Unix socket, with a time-out, and the restarts that its log tells."""

from __future__ import annotations

import http.client
import re
import socket
import time
import xmlrpc.client
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

_TIMEOUT_S = 3.0
_STARTED = re.compile(r"supervisord started with pid \d+")
_SPAWNED = re.compile(r"spawned: '(?P<name>[^']+)' with pid \d+")


class Unreachable(Exception):
    """No supervisor answers at the socket."""


@dataclass(frozen=True, slots=True)
class ProcessState:
    """A process as supervisor sees it.

    Attributes:
        name: the process.
        state: supervisor's word: RUNNING, STARTING, BACKOFF, FATAL, STOPPING, STOPPED, EXITED, UNKNOWN.
        pid: its id, None where it does not run.
        uptime_s: seconds since its last start, 0 where it does not run.
        restarts: starts after the first one, since this supervisor began.
    """

    name: str
    state: str
    pid: int | None
    uptime_s: float
    restarts: int


class _Connection(http.client.HTTPConnection):
    """HTTP over a Unix socket."""

    def __init__(self, path: Path) -> None:
        super().__init__("localhost", timeout=_TIMEOUT_S)
        self._path = path

    def connect(self) -> None:
        self.sock = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        self.sock.settimeout(self.timeout)
        self.sock.connect(str(self._path))


class _Transport(xmlrpc.client.Transport):
    def __init__(self, path: Path) -> None:
        super().__init__()
        self._path = path

    def make_connection(self, host: object) -> _Connection:  # noqa: ARG002, the socket's path says where
        return _Connection(self._path)


class SupervisorClient:
    """Questions to a robot's supervisor; each raises :class:`Unreachable` where none answers."""

    def __init__(self, path: Path) -> None:
        self._path = path

    def pid(self) -> int:
        """The supervisor's own process id."""
        return int(self._call("supervisor.getPID"))

    def alive(self) -> bool:
        """Whether a supervisor answers."""
        try:
            self.pid()
        except Unreachable:
            return False
        return True

    def shutdown(self) -> None:
        """Asks the supervisor to stop every process and end; returns at once."""
        self._call("supervisor.shutdown")

    def processes(self, log: Path) -> list[ProcessState]:
        """Every process, with its restarts as counted in supervisor's ``log``."""
        infos = self._call("supervisor.getAllProcessInfo")
        restarts = count_restarts(_lines(log))
        return [
            ProcessState(
                name=info["name"],
                state=info["statename"],
                pid=info["pid"] or None,
                uptime_s=float(info["now"] - info["start"]) if info["pid"] else 0.0,
                restarts=restarts.get(info["name"], 0),
            )
            for info in infos
        ]

    def _call(self, method: str) -> Any:  # noqa: ANN401, XML-RPC's values are untyped
        proxy = xmlrpc.client.ServerProxy("http://localhost", transport=_Transport(self._path))
        try:
            return getattr(proxy, method)()
        except xmlrpc.client.Fault as fault:
            # SHUTDOWN_STATE: it is on its way out, which is as good as gone.
            raise Unreachable(fault.faultString) from None
        except (OSError, http.client.HTTPException, xmlrpc.client.ProtocolError) as error:
            raise Unreachable(str(error)) from None


def count_restarts(lines: Iterable[str]) -> dict[str, int]:
    """Starts of each process after its first one, since the last start of the supervisor in its log.

    Supervisor keeps no count of its own. Its log names every start, those that failed too, so that a process which
    could not be started at first counts as restarted.
    """
    spawned: Counter[str] = Counter()
    for line in lines:
        if _STARTED.search(line):
            spawned.clear()
        elif match := _SPAWNED.search(line):
            spawned[match["name"]] += 1
    return {name: count - 1 for name, count in spawned.items()}


def wait_gone(client: SupervisorClient, deadline_s: float) -> bool:
    """Waits until no supervisor answers any more, and says whether that came within ``deadline_s`` seconds."""
    end = time.monotonic() + deadline_s
    while client.alive():
        if time.monotonic() > end:
            return False
        time.sleep(0.05)
    return True


def _lines(log: Path) -> list[str]:
    """The log's lines, oldest first, with those that were rotated away."""
    rotated = sorted(log.parent.glob(f"{log.name}.[0-9]"), reverse=True)
    lines: list[str] = []
    for path in (*rotated, log):
        try:
            lines += path.read_text(encoding="utf-8", errors="replace").splitlines()
        except OSError:
            continue
    return lines
