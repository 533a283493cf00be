"""A robot's processes under ``supervisor``: start, wait until all are present, watch, stop.

``vtr up``, ``vtr demo`` and the integration tests all use :class:`Supervised`.
"""

from __future__ import annotations

import contextlib
import os
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from types import TracebackType
from typing import Self

from cli import client, robot
from cli.errors import CommandError
from cli.processes import Process, table_of
from cli.supervision import endpoints
from cli.supervision.client import ProcessState, SupervisorClient, Unreachable, wait_gone
from cli.supervision.files import SupervisorFiles, environment_of, render

_ANSWER_DEADLINE_S = 5.0
_STOP_DEADLINE_S = 4.0
_POLL_S = 0.1

Present = Callable[[frozenset[str]], None]


class Supervised:
    """The processes of one robot under one supervisor.

    As a context manager it starts them, waits until all are present, and stops them at the end of the block.
    """

    def __init__(self, config_path: Path, table: Sequence[Process] | None = None) -> None:
        """Reads the configuration, but for the services' own tables, which are checked at the start.

        Raises:
            ConfigurationError: the file, or its table ``[robot]`` or ``[bus]``, is wrong.
        """
        self.config = robot.load(config_path)
        self.table = table_of(self.config) if table is None else tuple(table)
        self.files = SupervisorFiles.of(self.config)
        self.client = SupervisorClient(self.files.socket)
        self._daemon: subprocess.Popen[bytes] | None = None

    def __enter__(self) -> Self:
        self.start()
        try:
            self.wait_ready()
        except BaseException:
            self.stop()
            raise
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.stop()

    def start(self, *, detached: bool = False) -> None:
        """Starts the supervisor, which starts the processes; returns when it answers.

        Unless ``detached``, supervisor and processes end when this process does, even by ``kill -9``.

        Raises:
            CommandError: the robot is already running, or the supervisor did not start.
            ConfigurationError: a table of the configuration is wrong, the robot's directory cannot be written to, or
                the router's port is in use.
        """
        robot.check(self.config, self.table)
        with contextlib.suppress(Unreachable):
            raise CommandError(
                f"{self.config.who} is already running under supervisor {self.client.pid()}: vtr down stops it"
            )
        endpoints.parse(self.config.bus.endpoint).check_free()
        self.files.make()
        self.files.configuration.write_text(render(self.files, self.table), encoding="utf-8")
        self._daemon = self._spawn(detached=detached)
        try:
            self._wait_answer(self._daemon)
        except BaseException:
            self.stop()
            raise

    def wait_ready(self, deadline: float | None = None, on_change: Present | None = None) -> None:
        """Waits until every process is present on the bus; ``on_change`` hears which are.

        Args:
            deadline: seconds for all of them; by default each has the deadline of its row in the table.
            on_change: called with the names of the present processes, whenever these change.

        Raises:
            CommandError: a process is not there in time, or supervisor has given up on it; the others still run.
        """
        start = time.monotonic()
        first = min(process.start_deadline_s for process in self.table)
        self._wait_router(start + (deadline or first))
        seen: frozenset[str] | None = None
        with client.connect(self.config, timeout=5) as bus:
            presence = bus.presence()
            while True:
                present = presence.alive()
                missing = [process for process in self.table if process.name not in present]
                if present != seen and on_change is not None:
                    on_change(present)
                if not missing:
                    return
                seen = present
                self._check(missing, time.monotonic() - start, deadline)
                time.sleep(_POLL_S)

    def running(self) -> bool:
        """Whether the robot's supervisor runs."""
        if self._daemon is not None:
            return self._daemon.poll() is None
        return self.client.alive()

    def exit_status(self) -> int | None:
        """How our own supervisor ended, negative by a signal; None while it runs."""
        return None if self._daemon is None else self._daemon.poll()

    def processes(self) -> list[ProcessState]:
        """The processes as the supervisor sees them, in the order of the table; none where it does not run."""
        try:
            states = {state.name: state for state in self.client.processes(self.files.supervisor_log)}
        except Unreachable:
            return []
        return [states[process.name] for process in self.table if process.name in states]

    def stop(self) -> None:
        """Stops every process and the supervisor, within some three seconds; does nothing where none runs.

        Raises:
            CommandError: the supervisor of another process would not end.
        """
        if self._daemon is not None:
            self._end(self._daemon)
            self._daemon = None
            return
        try:
            pid = self.client.pid()
            self.client.shutdown()
        except Unreachable:
            return
        if not wait_gone(self.client, _STOP_DEADLINE_S):
            raise CommandError(f"the supervisor does not end: kill -9 {pid} ends it and its processes")

    def _spawn(self, *, detached: bool) -> subprocess.Popen[bytes]:
        command = [sys.executable, "-P", "-m", "cli.supervision.daemon", str(self.files.configuration)]
        environment = {
            **os.environ,
            **environment_of(self.config),
            "VTR_PARENT": str(os.getpid()),
        }
        with self._output.open("wb") as output:
            return subprocess.Popen(  # noqa: S603, our own module
                command if detached else [*command, "--attached"],
                env=environment,
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=output,
                start_new_session=True,
            )

    def _end(self, daemon: subprocess.Popen[bytes]) -> None:
        """Ends our own supervisor, which stops its processes; if it is killed, each of them ends by itself."""
        try:
            self.client.shutdown()  # it may take a second to notice a signal
        except Unreachable:
            daemon.terminate()
        try:
            daemon.wait(_STOP_DEADLINE_S)
        except subprocess.TimeoutExpired:
            daemon.kill()
            daemon.wait()

    def _wait_answer(self, daemon: subprocess.Popen[bytes]) -> None:
        end = time.monotonic() + _ANSWER_DEADLINE_S
        while not self.client.alive():
            if daemon.poll() is not None or time.monotonic() > end:
                raise CommandError(f"the supervisor did not start: {self._last_words()}")
            time.sleep(_POLL_S / 2)

    def _wait_router(self, end: float) -> None:
        address = endpoints.parse(self.config.bus.endpoint)
        while not address.answers(_POLL_S):
            self._check([], 0.0, None)
            if time.monotonic() > end:
                log = self.files.process_log("router")
                raise CommandError(f"the router did not come up in time: {last_line(log)} (log: {log})")
            time.sleep(_POLL_S)

    def _check(self, missing: Sequence[Process], elapsed: float, deadline: float | None) -> None:
        """Raises for what will not come: a supervisor that is gone, a process given up on, or one that is late."""
        if not self.running():
            raise CommandError(f"the supervisor ended: {self._last_words()}")
        for state in self.processes():
            if state.state == "FATAL":
                log = self.files.process_log(state.name)
                raise CommandError(f"'{state.name}' does not stay up: {last_line(log)} (log: {log})")
        for process in missing:
            if elapsed > (process.start_deadline_s if deadline is None else deadline):
                log = self.files.process_log(process.name)
                raise CommandError(f"'{process.name}' was not up after {elapsed:.0f} s: {last_line(log)} (log: {log})")

    @property
    def _output(self) -> Path:
        return self.files.log / "supervisord.out"

    def _last_words(self) -> str:
        return f"{last_line(self._output, last_line(self.files.supervisor_log))} (log: {self.files.supervisor_log})"


def last_line(path: Path, default: str = "it has logged nothing") -> str:
    """The last line of a text file that is not blank."""
    try:
        lines = path.read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        return default
    return next((line.strip() for line in reversed(lines) if line.strip()), default)
