"""Every check of ``vtr doctor``, in the order of its report."""

from __future__ import annotations

from pathlib import Path

from cli import robot
from cli.doctor.access import check_access
from cli.doctor.calibration import check_calibration
from cli.doctor.certificates import check_certificates
from cli.doctor.check import Check
from cli.doctor.machine import check_clock, check_dependencies, check_python, check_resources, check_shared_memory
from cli.doctor.page import check_page
from cli.doctor.storage import check_storage
from cli.doctor.store import check_disk, check_store
from cli.doctor.traffic import check_bus, check_fleet_clock
from common.config import RobotConfig
from common.errors import RetraverseError


def all_checks(path: Path | None) -> list[Check]:
    """Every check; those of the robot, or of the fleet's server, only where its configuration can be used."""
    checks = [check_python(), check_dependencies(), check_resources(), check_shared_memory(), check_clock()]
    configuration, check = check_configuration(path)
    checks.append(check)
    if configuration is not None:
        checks += _of(configuration)
    return checks


def _of(configuration: RobotConfig) -> list[Check]:
    of_robot = [] if configuration.of_fleet else [check_store(configuration), check_calibration(configuration)]
    return [
        check_disk(configuration.directory.absolute()),
        *of_robot,
        check_access(configuration),
        check_certificates(configuration),
        *check_storage(configuration),
        *check_fleet_clock(configuration),
        *check_bus(configuration),
        check_page(configuration),
    ]


def check_configuration(path: Path | None) -> tuple[RobotConfig | None, Check]:
    """Whether every table of the file is right; the configuration where it can be read."""
    if path is None and not robot.DEFAULT.is_file():
        return None, Check("configuration", "warn", "no robot is named", "name its TOML file with --config")
    try:
        configuration = robot.load(path)
        robot.check(configuration)
    except RetraverseError as error:
        return None, Check("configuration", "fail", str(error), "deploy/robot.toml and fleet.toml explain each key")
    tables = ", ".join(configuration.tables) or "defaults for every service"
    return configuration, Check("configuration", "ok", f"{configuration.path}: {configuration.who}, {tables}")
