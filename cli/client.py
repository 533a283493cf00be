"""A command's own session on a robot's bus: it finds the router within two seconds, or says that there is none."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator

from cli.supervision import endpoints
from common import logs
from common.bus import Bus
from common.config import RobotConfig
from common.errors import NoRouter

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
    with _open(configuration, process, timeout) as bus:
        yield bus


def _open(configuration: RobotConfig, process: str, timeout: float) -> Bus:
    name, table = configuration.robot.name, configuration.bus
    missing = NoRouter(f"no router answers at {table.endpoint}: is the robot up? vtr up {configuration.path}")
    # Where nobody listens at all there is nothing to wait for.
    if not endpoints.parse(table.endpoint).answers(timeout / 4):
        raise missing
    try:
        return Bus(name, process, table.endpoint, shared_memory=table.shared_memory, timeout=0.75 * timeout)
    except NoRouter:
        raise missing from None
