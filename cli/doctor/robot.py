"""What ``vtr doctor`` checks of one robot: its configuration, its router, and what is present on its bus."""

from __future__ import annotations

import time
from pathlib import Path

from cli import client, robot
from cli.doctor.machine import (
    Check,
    check_clock,
    check_dependencies,
    check_disk,
    check_python,
    check_resources,
    check_shared_memory,
)
from cli.processes import ROBOT
from cli.supervision import endpoints
from common.config import RobotConfig
from common.errors import ConfigurationError, NoRouter, RetraverseError

_PRESENCE_S = 0.3
_OTHER_PORT = "set another endpoint in [bus]"


def all_checks(path: Path | None) -> list[Check]:
    """Every check; those of the robot only where its configuration can be read."""
    checks = [check_python(), check_dependencies(), check_resources(), check_shared_memory(), check_clock()]
    configuration, check = check_configuration(path)
    checks.append(check)
    if configuration is not None:
        checks += [check_disk(configuration.directory.absolute()), check_router(configuration)]
    return checks


def check_configuration(path: Path | None) -> tuple[RobotConfig | None, Check]:
    """Whether every table of the robot's file is right; the configuration where it can be read."""
    if path is None and not robot.DEFAULT.is_file():
        return None, Check("configuration", "warn", "no robot is named", "name its TOML file with --config")
    try:
        configuration = robot.load(path)
        robot.check(configuration)
    except RetraverseError as error:
        return None, Check("configuration", "fail", str(error), "deploy/robot.toml explains each key")
    tables = ", ".join(configuration.tables) or "defaults for every service"
    return configuration, Check(
        "configuration", "ok", f"{configuration.path}: robot '{configuration.robot.name}', {tables}"
    )


def check_router(configuration: RobotConfig) -> Check:
    """Whether the router's port is free, or answered by this robot's own router."""
    endpoint = configuration.bus.endpoint
    try:
        address = endpoints.parse(endpoint)
        if not address.answers(1.0):
            address.check_free()
            return Check("router", "ok", f"{endpoint} is free; the robot is down")
        with client.connect(configuration) as bus:
            presence = bus.presence()
            time.sleep(_PRESENCE_S)
            present = presence.alive()
    except NoRouter:
        return Check("router", "fail", f"{endpoint} is used by a program that is no router", _OTHER_PORT)
    except ConfigurationError as error:
        return Check("router", "fail", str(error), _OTHER_PORT)
    missing = [process.name for process in ROBOT if process.name not in present]
    if "router" in missing:
        name = configuration.robot.name
        return Check("router", "fail", f"{endpoint} belongs to another robot than '{name}'", _OTHER_PORT)
    if missing:
        return Check("router", "warn", f"{endpoint} answers; not present: {', '.join(missing)}", "see vtr ps")
    return Check("router", "ok", f"{endpoint} answers, every process is present")
