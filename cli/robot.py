"""Which robot a command is about, and whether its whole configuration is right."""

from __future__ import annotations

import importlib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from cli.errors import CommandError
from cli.processes import FLEET, ROBOT, Process, table_of
from common import config

DEFAULT = Path("robot.toml")


FLEET_DEFAULT = Path("fleet.toml")


def find_fleet(path: Path | None) -> Path:
    """The fleet server's configuration: the one named, else ``./fleet.toml``.

    Raises:
        CommandError: none is named and there is none here, or it is a robot's.
        ConfigurationError: the file cannot be read or used.
    """
    if path is None and not FLEET_DEFAULT.is_file():
        raise CommandError("no fleet is named: give its server's TOML file, or put fleet.toml here")
    found = (path or FLEET_DEFAULT).expanduser().absolute()
    if not config.load(found).of_fleet:
        raise CommandError(f"{found} is a robot's configuration: vtr up starts it")
    return found


def find_own(path: Path | None) -> Path:
    """A robot's configuration, as :func:`find`.

    Raises:
        CommandError: none is named and there is none here, or it is the fleet server's.
        ConfigurationError: the file cannot be read or used.
    """
    found = find(path)
    if config.load(found).of_fleet:
        raise CommandError(f"{found} is the fleet server's configuration: vtr fleet up starts it")
    return found


def find(path: Path | None) -> Path:
    """The configuration to use: the one named, else ``./robot.toml``.

    Raises:
        CommandError: none is named, and there is none here.
    """
    if path is not None:
        return path.expanduser().absolute()
    if DEFAULT.is_file():
        return DEFAULT.absolute()
    raise CommandError("no robot is named: give its TOML file with --config or in VTR_CONFIG, or put robot.toml here")


def load(path: Path | None) -> config.RobotConfig:
    """The robot's configuration with ``[robot]`` and ``[bus]`` checked, which is all that a client needs.

    Raises:
        CommandError: no robot is named.
        ConfigurationError: the file cannot be read or used.
    """
    return config.load(find(path))


def settings_kinds(table: Sequence[Process] = ROBOT) -> dict[str, type[Any]]:
    """The settings class of each process, by the name of its table in the TOML file."""
    return {process.name: importlib.import_module(f"{process.module}.settings").Settings for process in table}


def page_address(configuration: config.RobotConfig) -> str:
    """Where the robot's web page is served.

    Raises:
        ConfigurationError: a key or value of ``[console]`` is wrong.
    """
    from services.console.settings import Settings

    return configuration.settings("console", Settings).address


def check(configuration: config.RobotConfig, table: Sequence[Process] | None = None) -> None:
    """Checks the tables of all services of a robot or, where it is that, of the fleet's server.

    ``table`` are the processes that may have one; by default those that the configuration is of.

    Raises:
        ConfigurationError: a table is no service's, or a key or value in it is wrong.
    """
    of_robot = table_of(configuration) if table is None else table
    config.check_tables(configuration, settings_kinds(FLEET if configuration.of_fleet else of_robot))
