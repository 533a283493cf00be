"""A command's own session on a robot's bus: it finds the router within two seconds, or says that there is none."""

from __future__ import annotations

import contextlib
import queue
import threading
import time
from collections.abc import Iterator

from cli import endpoints
from common import logs
from common.bus import Bus
from common.config import RobotConfig
from common.errors import NoRouter, RetraverseError

OPERATOR = "operator"
"""The name of an operator's command on the bus."""


@contextlib.contextmanager
def connect(
    configuration: RobotConfig, process: str = OPERATOR, *, timeout: float = 2.0, log_level: str = "critical"
) -> Iterator[Bus]:
    """A session with the robot's router, closed at the end of the block.

    Raises:
        NoRouter: no router answers within ``timeout`` seconds.
    """
    logs.configure(configuration.robot.name, process, log_level)
    bus = _open(configuration, process, timeout)
    try:
        yield bus
    finally:
        bus.close()


def _open(configuration: RobotConfig, process: str, timeout: float) -> Bus:
    """Opens the session in a thread, for Zenoh waits for a router as long as it takes."""
    start = time.monotonic()
    endpoint = configuration.bus.endpoint
    missing = NoRouter(f"no router answers at {endpoint}: is the robot up? vtr up {configuration.path}")
    if not endpoints.parse(endpoint).answers(timeout / 2):
        raise missing
    opened: queue.SimpleQueue[Bus | RetraverseError] = queue.SimpleQueue()

    def attempt() -> None:
        try:
            opened.put(Bus(configuration.robot.name, process, endpoint, shared_memory=configuration.bus.shared_memory))
        except RetraverseError as error:
            opened.put(error)

    threading.Thread(target=attempt, name="open", daemon=True).start()
    try:
        result = opened.get(timeout=max(0.1, start + timeout - time.monotonic()))
    except queue.Empty:
        raise missing from None
    if isinstance(result, RetraverseError):
        raise result
    return result
