"""Which robot a command is about, and whether its whole configuration is right."""

from __future__ import annotations

import importlib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from cli.errors import CommandError
from cli.processes import ROBOT, Process
from common import config

DEFAULT = Path("robot.toml")


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


def check(configuration: config.RobotConfig, table: Sequence[Process] = ROBOT) -> None:
    """Checks the tables of all services.

    Raises:
        ConfigurationError: a table is no service's, or a key or value in it is wrong.
    """
    config.check_tables(configuration, settings_kinds(table))
