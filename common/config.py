"""A robot's configuration: one TOML file, a table for the robot, one for the bus, and one for each service.

A service's table is described by the ``Settings`` dataclass of its own ``settings.py``, which holds the defaults.
"""

from __future__ import annotations

import dataclasses
import difflib
import tomllib
import typing
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar, cast

from pydantic import BaseModel, ConfigDict, Field, StringConstraints, ValidationError, create_model

from common.errors import ConfigurationError
from common.ids import NAME_PATTERN

S = TypeVar("S")

Name = Annotated[str, StringConstraints(pattern=NAME_PATTERN)]


class RobotTable(BaseModel):
    """``[robot]``: its name, what it localizes by, the environment that it works in, and the folder of its data."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    name: Name
    sensor: Literal["stereo", "lidar", "bearing"] = "stereo"
    environment: Name = "default"
    directory: Path = Path("~/.local/share/retraverse")
    log_level: Literal["debug", "info", "warning", "error"] = "info"
    log_json: bool = False


class BusTable(BaseModel):
    """``[bus]``: the robot's router, which the processes are clients of."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    endpoint: Annotated[str, StringConstraints(pattern=r"^(tcp|unixsock-stream)/.+")] = "tcp/127.0.0.1:7447"
    shared_memory: bool = True


class _File(BaseModel):
    model_config = ConfigDict(extra="allow", frozen=True)

    robot: RobotTable
    bus: BusTable = Field(default_factory=BusTable)


@dataclasses.dataclass(frozen=True, slots=True)
class RobotConfig:
    """A checked configuration, and the tables of the services, each checked when its service asks for it."""

    path: Path
    robot: RobotTable
    bus: BusTable
    tables: dict[str, dict[str, Any]]

    @property
    def directory(self) -> Path:
        """The robot's own folder: its store, its latch, its logs; a relative one begins at the file's own folder."""
        return (self.path.absolute().parent / self.robot.directory.expanduser()) / self.robot.name

    def settings(self, table: str, kind: type[S]) -> S:
        """A service's table as its settings dataclass.

        Raises:
            ConfigurationError: a wrong key or value, with the nearest right key where there is one.
        """
        # A dataclass takes the strictness of the model that it is a field of.
        fields: dict[str, Any] = {table: (kind, ...)}
        model = create_model(
            "Tables",
            __config__=ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False, arbitrary_types_allowed=True),
            **fields,
        )
        try:
            return cast("S", getattr(model.model_validate({table: self.tables.get(table, {})}), table))
        except ValidationError as error:
            raise ConfigurationError(_sentence(self.path, error, model)) from None


def load(path: Path) -> RobotConfig:
    """The configuration in a TOML file.

    Raises:
        ConfigurationError: no such file, no TOML, or a wrong key or value in ``[robot]`` or ``[bus]``.
    """
    try:
        content = tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise ConfigurationError(f"cannot read the configuration {path}: {error.strerror}") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ConfigurationError(f"{path} is not TOML: {error}") from None
    try:
        file = _File.model_validate(content)
    except ValidationError as error:
        raise ConfigurationError(_sentence(path, error, _File)) from None
    extra = file.model_extra or {}
    for name, table in extra.items():
        if not isinstance(table, dict):
            raise ConfigurationError(f"{path}: '{name}' stands outside of any table; put it under [robot] or a service")
    return RobotConfig(path, file.robot, file.bus, extra)


def check_tables(config: RobotConfig, kinds: dict[str, type[Any]]) -> None:
    """Checks every table of a configuration against the settings of the services.

    Raises:
        ConfigurationError: an unknown table, or a wrong key or value in a known one.
    """
    for name in config.tables:
        if name not in kinds:
            hint = _hint(name, list(kinds))
            raise ConfigurationError(f"{config.path}: [{name}] is the table of no service{hint}")
    for name, kind in kinds.items():
        config.settings(name, kind)


def _sentence(path: Path, error: ValidationError, kind: type[Any]) -> str:
    """One sentence on the first thing that is wrong."""
    first = error.errors(include_url=False)[0]
    location = tuple(map(str, first["loc"]))
    if first["type"] in ("extra_forbidden", "unexpected_keyword_argument"):
        return f"{path}: '{'.'.join(location)}' is no setting{_hint(location[-1], _keys(kind, location[:-1]))}"
    if first["type"] == "missing":
        return f"{path}: '{'.'.join(location)}' is missing"
    return f"{path}: '{'.'.join(location)}': {first['msg'].removeprefix('Value error, ')}, got {first['input']!r}"


def _hint(word: str, known: list[str]) -> str:
    near = difflib.get_close_matches(word, known, 1)
    return f"; did you mean '{near[0]}'?" if near else ""


def _keys(kind: Any, location: tuple[str, ...]) -> list[str]:  # noqa: ANN401, a class or a field's type
    """The settings known at a place of a dataclass or model."""
    for step in location:
        fields = getattr(kind, "model_fields", None)
        hints = {k: f.annotation for k, f in fields.items()} if fields else typing.get_type_hints(kind)
        kind = hints.get(step)
    if dataclasses.is_dataclass(kind):
        return [field.name for field in dataclasses.fields(kind)]
    return list(getattr(kind, "model_fields", {}))
