"""A command's own session on a robot's bus: it finds the router within two seconds, or says that there is none."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator

from cli.supervision import endpoints
from common import logs
from common.access.link import client_settings
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
    who, command = ("fleet's server", "vtr fleet up") if configuration.of_fleet else ("robot", "vtr up")
    missing = NoRouter(f"no router answers at {table.endpoint}: is the {who} up? {command} {configuration.path}")
    access = client_settings(configuration, process)
    encrypted = "transport/link/tls" in access
    # Where nobody listens at all there is nothing to wait for; a router logs who knocks and has no certificate.
    if not encrypted and not endpoints.parse(table.endpoint).answers(timeout / 4):
        raise missing
    try:
        return Bus(
            name,
            process,
            table.endpoint,
            shared_memory=table.shared_memory,
            timeout=0.75 * timeout,
            access=access,
        )
    except NoRouter:
        if not access or (encrypted and not endpoints.parse(table.endpoint).answers(timeout / 4)):
            raise missing from None
        shown = "certificate" if encrypted else "password"
        raise NoRouter(f"the router at {table.endpoint} does not take this {shown}: its log says why") from None
