"""Real processes of a robot on a port and in a folder of its own, and sessions that act as the others."""

from __future__ import annotations

import contextlib
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from types import TracebackType
from typing import Self, TypeVar

from common.bus import Bus, Presence

T = TypeVar("T")

ROOT = Path(__file__).resolve().parents[1]
START_DEADLINE_S = 60.0
DEADLINE_S = 10.0

_STAND_IN = """
import sys, threading
from common.bus import Bus
with Bus(sys.argv[1], sys.argv[2], sys.argv[3], shared_memory=False) as bus:
    bus.present()
    threading.Event().wait()
"""


def free_port() -> int:
    """A TCP port of the loopback that nobody listens on now."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
        return port


def eventually(value: Callable[[], T | None], what: str, deadline: float = DEADLINE_S) -> T:
    """The first true value, asked for again and again; fails with ``what`` after ``deadline`` seconds."""
    end = time.monotonic() + deadline
    pause = threading.Event()
    while not (found := value()):
        assert time.monotonic() < end, f"not within {deadline:g} s: {what}"
        pause.wait(0.01)
    return found


class Robot:
    """A robot whose processes are started one by one; all of them are killed at the end of the block."""

    def __init__(self, folder: Path, tables: str = "", name: str = "r1", beside: Robot | None = None) -> None:
        """Writes the configuration into ``folder``; ``tables`` is TOML for the services.

        The robot has a router of its own, or shares that of the one that it stands ``beside``.
        """
        self.name = name
        self.folder = folder
        self._has_router = beside is None
        self.endpoint = f"tcp/127.0.0.1:{free_port()}" if beside is None else beside.endpoint
        self.config = folder / "robot.toml"
        self.config.write_text(
            f'[robot]\nname = "{name}"\ndirectory = "{folder}"\n'
            f'[bus]\nendpoint = "{self.endpoint}"\nshared_memory = false\n{tables}',
            encoding="utf-8",
        )
        self._processes: dict[str, subprocess.Popen[bytes]] = {}
        self._buses = contextlib.ExitStack()
        self._presence: Presence | None = None

    def __enter__(self) -> Self:
        if self._has_router:
            self.start_router()
        self._presence = self.bus("observer").presence()
        if self._has_router:
            self._wait_for("router")
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._buses.close()
        for process in self._processes.values():
            process.kill()
            process.wait()

    def start_router(self) -> None:
        """Starts the robot's own router, at first or anew."""
        self._launch("router", [sys.executable, "-m", "services.router", "--config", str(self.config)])

    def start(self, service: str) -> subprocess.Popen[bytes]:
        """Starts a service as its own process and waits until it is present."""
        process = self._launch(service, [sys.executable, "-m", f"services.{service}", "--config", str(self.config)])
        self._wait_for(service)
        return process

    def stand_in(self, process: str) -> None:
        """Starts a process that is present under another's name and does nothing."""
        self._launch(process, [sys.executable, "-c", _STAND_IN, self.name, process, self.endpoint])
        self._wait_for(process)

    def kill(self, process: str) -> None:
        """Kills a process as ``kill -9`` does, and waits until it is gone."""
        self._processes[process].kill()
        self._processes[process].wait()
        presence = self._presence
        assert presence is not None
        eventually(lambda: process not in presence, f"{process} is still present")

    def alive(self, process: str) -> bool:
        """Whether a process still runs."""
        return self._processes[process].poll() is None

    def bus(self, process: str) -> Bus:
        """A session under a process's name, closed at the end."""
        return self._buses.enter_context(Bus(self.name, process, self.endpoint, shared_memory=False))

    def act_as(self, process: str) -> Bus:
        """A session under a process's name that is present as that process."""
        bus = self.bus(process)
        bus.present()
        self._wait_for(process)
        return bus

    def log(self, process: str) -> str:
        """What a process has written so far."""
        return (self.folder / f"{process}.log").read_text(encoding="utf-8", errors="replace")

    def _launch(self, name: str, command: list[str]) -> subprocess.Popen[bytes]:
        with (self.folder / f"{name}.log").open("ab") as log:
            process = subprocess.Popen(command, cwd=ROOT, stdout=log, stderr=subprocess.STDOUT)
        self._processes[name] = process
        return process

    def _wait_for(self, name: str) -> None:
        def present() -> bool:
            process = self._processes.get(name)
            assert process is None or process.poll() is None, f"{name} has ended:\n{self.log(name)}"
            return self._presence is not None and name in self._presence

        eventually(present, f"{name} is present", START_DEADLINE_S)


@contextlib.contextmanager
def every(period: float, action: Callable[[], object]) -> Iterator[None]:
    """Repeats an action every ``period`` seconds in a thread of its own until the end of the block."""
    stop = threading.Event()

    def repeat() -> None:
        while not stop.wait(period):
            action()

    thread = threading.Thread(target=repeat, daemon=True)
    thread.start()
    try:
        yield
    finally:
        stop.set()
        thread.join()
