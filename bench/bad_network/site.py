"""The machines of the run: a network namespace for each robot and one for the server, their files and processes."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import time
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType
from typing import IO, Self

import psutil

from bench.bad_network.plan import Plan
from bench.bad_network.wire import DEVICE

FLEET = "fleet"
SERVER_ADDRESS = "10.77.0.254"
ROUTER, STORAGE = f"tcp/{SERVER_ADDRESS}:7448", f"http://{SERVER_ADDRESS}:8333"
ENVIRONMENT = "yard"
OF_ROBOT = ("router", "mapstore", "safety", "navigator")
OF_SERVER = ("router", "storage", "fleet")
HELD_S = 1.0
"""Silence of the operator's dead man's switch after which a robot stops: three lost packets in a row may come late."""

_ROOT = Path(__file__).resolve().parents[2]
_START_S = 180.0


def address_of(robot: str) -> str:
    """The robot's address on the wire."""
    return f"10.77.0.{int(robot[1:])}"


@dataclass(slots=True)
class Site:
    """Everything that was started, in the order of its start; a context manager that leaves nothing behind."""

    folder: Path
    plan: Plan
    processes: dict[str, subprocess.Popen[bytes]] = field(default_factory=dict)
    wire: subprocess.Popen[str] | None = None

    def __enter__(self) -> Self:
        try:
            self._lay_wire()
            self._write_files()
        except BaseException:
            self._clear()
            raise
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._clear()

    def namespace(self, name: str) -> str:
        """The network namespace of a robot, or of the server."""
        return f"vtr-{os.getpid()}-{name}"

    def config(self, name: str) -> Path:
        """The TOML file of a robot, or of the server."""
        return self.folder / f"{name}.toml"

    def run(self, name: str, where: str, module: str, *arguments: str) -> None:
        """Starts a module in a namespace; its output goes to a log of its name."""
        command = ["ip", "netns", "exec", self.namespace(where), sys.executable, "-m", module, *arguments]
        environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
        with (self.folder / f"{name}.log").open("ab") as log:
            self.processes[name] = subprocess.Popen(  # noqa: S603, our own modules
                command, cwd=_ROOT, env=environment, stdin=subprocess.DEVNULL, stdout=log, stderr=log
            )

    def start_services(self) -> None:
        """The server's processes, and each robot's; each writes ``ready`` into its log."""
        for where, services in ((FLEET, OF_SERVER), *((robot, OF_ROBOT) for robot in self.plan.robots)):
            for service in services:
                self.run(f"{where}.{service}", where, f"services.{service}", "--config", str(self.config(where)))
            for service in services:
                self._wait_log(f"{where}.{service}", "event=ready")

    def begin(self, plan: Plan) -> None:
        """From now on the wire is as bad as the plan says."""
        self.plan = plan
        self._tell_wire(plan)

    def end_wire(self) -> dict[str, dict[str, int]]:
        """Cuts the wire for good; what it carried of each robot's packets."""
        assert self.wire is not None
        out, _ = self.wire.communicate(timeout=10)
        carried: dict[str, dict[str, int]] = json.loads(out.splitlines()[-1])
        return carried

    def figures(self) -> dict[str, tuple[float, float]]:
        """Seconds of processor time and megabytes of memory of each process and its children, by name."""
        found = {}
        for name, started in self.processes.items():
            try:
                process = psutil.Process(started.pid)
                family = [process, *process.children(recursive=True)]
                times = [p.cpu_times() for p in family]
                memory = sum(p.memory_info().rss for p in family)
            except psutil.Error:
                continue
            found[name] = (sum(t.user + t.system for t in times), memory / 1e6)
        return found

    # --- wire and files ----------------------------------------------------------------------------------------------

    def _lay_wire(self) -> None:
        ends = {FLEET: SERVER_ADDRESS, **{robot: address_of(robot) for robot in self.plan.robots}}
        for name in ends:
            _ip("netns", "add", self.namespace(name))
        command = [sys.executable, "-m", "bench.bad_network.wire"]
        command += [f"{self.namespace(name)}={name}={address}" for name, address in ends.items()]
        self.wire = subprocess.Popen(  # noqa: S603, our own module
            command, cwd=_ROOT, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )
        assert self._wire_out().readline() == "open\n"
        for name, address in ends.items():
            _ip("-n", self.namespace(name), "link", "set", "lo", "up")
            _ip("-n", self.namespace(name), "addr", "add", f"{address}/24", "dev", DEVICE)
            _ip("-n", self.namespace(name), "link", "set", DEVICE, "up")

    def _wire_out(self) -> IO[str]:
        assert self.wire is not None
        assert self.wire.stdout is not None
        return self.wire.stdout

    def _tell_wire(self, plan: Plan) -> None:
        assert self.wire is not None
        assert self.wire.stdin is not None
        self.wire.stdin.write(plan.text() + "\n")
        self.wire.stdin.flush()

    def _write_files(self) -> None:
        robots = json.dumps(list(self.plan.robots))
        self.config(FLEET).write_text(
            f'[server]\ndirectory = "{self.folder}/data"\n[bus]\nendpoint = "{ROUTER}"\nshared_memory = false\n'
            f'[storage]\nbind = "{SERVER_ADDRESS}"\nrobots = {robots}\n',
            encoding="utf-8",
        )
        for robot in self.plan.robots:
            credentials = self.folder / "data" / FLEET / "storage" / "credentials" / f"{robot}.json"
            self.config(robot).write_text(
                f'[robot]\nname = "{robot}"\nenvironment = "{ENVIRONMENT}"\ndirectory = "{self.folder}/data"\n'
                f'[bus]\nendpoint = "unixsock-stream/{self.folder}/{robot}.sock"\nfleet = "{ROUTER}"\n'
                f"shared_memory = false\n"
                f'[mapstore.sync]\nendpoint = "{STORAGE}"\ncredentials = "{credentials}"\n'
                f"[safety.rules]\ndead_mans_switch = true\ndead_mans_switch_age = {HELD_S}\n",
                encoding="utf-8",
            )

    def _wait_log(self, name: str, word: str) -> None:
        log, end = self.folder / f"{name}.log", time.monotonic() + _START_S
        while word not in log.read_text(encoding="utf-8", errors="replace"):
            if self.processes[name].poll() is not None or time.monotonic() > end:
                raise RuntimeError(f"{name} did not start: see {log}")
            time.sleep(0.1)

    def _clear(self) -> None:
        for process in reversed(list(self.processes.values())):
            process.terminate()
        for process in self.processes.values():
            try:
                process.wait(5)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
        if self.wire is not None:
            self.wire.kill()
            self.wire.wait()
        for name in (FLEET, *self.plan.robots):
            _ip("netns", "del", self.namespace(name), check=False)


def _ip(*arguments: str, check: bool = True) -> None:
    program = shutil.which("ip")
    if program is None:
        raise RuntimeError("'ip' is not installed: apt install iproute2")
    subprocess.run([program, *arguments], check=check, capture_output=not check)  # noqa: S603, our own arguments
