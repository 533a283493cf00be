"""What ``vtr up`` and ``vtr down`` do."""

from __future__ import annotations

import contextlib
import signal
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from cli import robot
from cli.errors import CommandError
from cli.output import emit, progress
from cli.processes import Process
from cli.supervision.supervised import Present, Supervised

_POLL_S = 0.2


def bring_up(config: Path, *, detach: bool, as_json: bool) -> None:
    """Starts a robot, or the fleet's server, and waits until it is up; in the foreground, stays until it is stopped.

    Raises:
        CommandError: a process did not come up, in which case all are stopped again, or the supervisor was killed.
    """
    supervised = Supervised(config)
    # SIGTERM ends the foreground as Ctrl-C does.
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    supervised.start(detached=detach)
    try:
        with _display(supervised.table) as on_change:
            supervised.wait_ready(on_change=on_change)
        _announce(supervised, as_json=as_json)
        if not detach:
            with contextlib.suppress(KeyboardInterrupt):
                _stay(supervised)
            supervised.stop()
    except BaseException:
        supervised.stop()
        raise


def bring_down(config: Path, *, as_json: bool) -> None:
    """Stops the processes of a robot, or of the fleet's server.

    Raises:
        CommandError: no supervisor runs them.
    """
    supervised = Supervised(config)
    name = supervised.config.robot.name
    if not supervised.running():
        raise CommandError(f"{supervised.config.who} is not running under a supervisor of its directory")
    supervised.stop()
    emit({"robot": name, "stopped": True}, f"{supervised.config.who} is down", as_json=as_json)


def _announce(supervised: Supervised, *, as_json: bool) -> None:
    states = supervised.processes()
    name, endpoint = supervised.config.robot.name, supervised.config.bus.endpoint
    data: dict[str, Any] = {
        "robot": name,
        "endpoint": endpoint,
        "log": str(supervised.files.log),
        "processes": {state.name: state.pid for state in states},
    }
    text = f"{supervised.config.who} is up: {len(states)} processes at {endpoint}, logs in {supervised.files.log}"
    if any(process.name == "console" for process in supervised.table):
        data["console"] = robot.page_address(supervised.config)
        text += f"\nits web page: {data['console']}"
    emit(data, text, as_json=as_json)


def _stay(supervised: Supervised) -> None:
    """Stays until the supervisor ends; raises where that was otherwise than by ``vtr down``."""
    while supervised.running():
        time.sleep(_POLL_S)
    status = supervised.exit_status()
    if status != 0:
        raise CommandError(f"the supervisor ended with status {status}, and the robot's processes with it")


@contextlib.contextmanager
def _display(table: Sequence[Process]) -> Iterator[Present]:
    """Shows how many processes are present, and which ones are awaited."""
    names = [process.name for process in table]
    with progress() as display:
        task = display.add_task("starting", total=len(names))

        def on_change(present: frozenset[str]) -> None:
            awaited = [name for name in names if name not in present]
            display.update(task, completed=len(names) - len(awaited), description=f"waiting for {', '.join(awaited)}")

        yield on_change
