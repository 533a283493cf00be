"""A robot's configuration: one TOML file, a table for the robot, one for the bus, and one for each service.

A service's table is described by the ``Settings`` dataclass of its own ``settings.py``, which holds the defaults.
"""

from __future__ import annotations

import dataclasses
import difflib
import tomllib
import typing
from pathlib import Path
from typing import Annotated, Any, Literal, Self, TypeVar, cast

from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Field,
    StringConstraints,
    ValidationError,
    create_model,
    model_validator,
)

from common.errors import ConfigurationError
from common.ids import NAME_PATTERN

S = TypeVar("S")

_RESERVED = "fleet"
"""Stands in keys where a robot's name stands else (:data:`common.topics.FLEET`)."""


def _not_reserved(name: str) -> str:
    if name == _RESERVED:
        raise ValueError(f"'{_RESERVED}' is the fleet server's own name: choose another")
    return name


Name = Annotated[str, StringConstraints(pattern=NAME_PATTERN)]


class RobotTable(BaseModel):
    """``[robot]``: its name, what it localizes by, the environment that it works in, and the folder of its data.

    Attributes:
        name: of the robot, unique in its fleet.
        sensor: what it localizes by; bearing is one camera and the wheels.
        environment: the set of maps that it works in.
        directory: store, logs and run files are in a folder of the robot's name there.
        log_level: of all its processes.
        log_json: whether a log line is a JSON object instead of ``key=value``.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    name: Annotated[Name, AfterValidator(_not_reserved)]
    sensor: Literal["stereo", "lidar", "bearing"] = "stereo"
    environment: Name = "default"
    directory: Path = Path("~/.local/share/retraverse")
    log_level: Literal["debug", "info", "warning", "error"] = "info"
    log_json: bool = False


class ServerTable(BaseModel):
    """``[server]`` in place of ``[robot]``: the fleet's server, and the folder of its data.

    Attributes:
        directory: storage, logs and run files are in the folder ``fleet`` there.
        log_level: of all its processes.
        log_json: whether a log line is a JSON object instead of ``key=value``.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    directory: Path = Path("~/.local/share/retraverse")
    log_level: Literal["debug", "info", "warning", "error"] = "info"
    log_json: bool = False

    def as_robot(self) -> RobotTable:
        """What the server's processes have in common with a robot's; the name is that of its keys."""
        return RobotTable.model_construct(
            name=_RESERVED, directory=self.directory, log_level=self.log_level, log_json=self.log_json
        )


class BusTable(BaseModel):
    """``[bus]``: the robot's router, which the processes are clients of, and the fleet's, which that is linked to.

    Attributes:
        endpoint: where the robot's router listens.
        fleet: the router of the fleet's server; without it the robot is on its own.
        fleet_frames_hz: images and scans a second, at most, that go to the fleet over an encrypted link.
        shared_memory: whether frames travel through /dev/shm.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    endpoint: Annotated[str, StringConstraints(pattern=r"^(tcp|unixsock-stream|tls|quic)/.+")] = "tcp/127.0.0.1:7447"
    fleet: Annotated[str, StringConstraints(pattern=r"^(tcp|tls|quic)/.+")] | None = None
    fleet_frames_hz: Annotated[float, Field(ge=0, le=1000)] = 2.0
    shared_memory: bool = True


class SecurityTable(BaseModel):
    """``[security]``: who this machine is to others, and who others are to it; paths begin at the file's folder.

    Attributes:
        ca: the fleet's authority, which signed every certificate.
        certificate, key: this machine's own.
        users: the folder of the passwords by which a robot's router tells the robot's processes apart.
        listen: where the fleet's router listens for robots, operators and viewers.
        members: the register of certificates, of which the fleet's router lets in those that count.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    ca: Path | None = None
    certificate: Path | None = None
    key: Path | None = None
    users: Path | None = None
    listen: Annotated[str, StringConstraints(pattern=r"^(tls|quic)/.+")] | None = None
    members: Path | None = None

    @model_validator(mode="after")
    def _whole(self) -> Self:
        named = (self.ca, self.certificate, self.key)
        if any(named) and not all(named):
            raise ValueError("'ca', 'certificate' and 'key' belong together in [security]")
        if (self.listen is None) != (self.members is None):
            raise ValueError("'listen' and 'members' belong together in [security]")
        if self.listen is not None and self.ca is None:
            raise ValueError("'listen' in [security] needs 'ca', 'certificate' and 'key'")
        return self


class _File(BaseModel):
    model_config = ConfigDict(extra="allow", frozen=True)

    robot: RobotTable | None = None
    server: ServerTable | None = None
    bus: BusTable = Field(default_factory=BusTable)
    security: SecurityTable | None = None

    @model_validator(mode="after")
    def _of_one(self) -> Self:
        if (self.robot is None) == (self.server is None):
            raise ValueError(
                "'robot' is missing, or beside 'server', which stands in its place in the fleet server's file"
            )
        if self.security is not None:
            _check_place(self.security, of_fleet=self.server is not None)
        return self


def _check_place(security: SecurityTable, *, of_fleet: bool) -> None:
    if of_fleet and security.users is not None:
        raise ValueError("'users' in [security] is for a robot: who connects to the fleet's router has certificates")
    if not of_fleet and security.listen is not None:
        raise ValueError("'listen' in [security] is for the fleet's server: others reach a robot through it")


@dataclasses.dataclass(frozen=True, slots=True)
class RobotConfig:
    """A checked configuration, and the tables of the services, each checked when its service asks for it.

    The fleet server's is one too, with ``of_fleet`` set and its reserved name for the robot's.
    """

    path: Path
    robot: RobotTable
    bus: BusTable
    tables: dict[str, dict[str, Any]]
    of_fleet: bool = False
    security: SecurityTable | None = None

    def beside(self, path: Path) -> Path:
        """A path of the file, which begins at the file's own folder."""
        return self.path.absolute().parent / path.expanduser()

    @property
    def directory(self) -> Path:
        """The robot's own folder: its store, its latch, its logs; a relative one begins at the file's own folder."""
        return (self.path.absolute().parent / self.robot.directory.expanduser()) / self.robot.name

    @property
    def who(self) -> str:
        """Whose configuration it is, in a sentence."""
        return "the fleet's server" if self.of_fleet else f"robot '{self.robot.name}'"

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
    if file.server is not None:
        return RobotConfig(path, file.server.as_robot(), file.bus, extra, of_fleet=True, security=file.security)
    return RobotConfig(path, cast("RobotTable", file.robot), file.bus, extra, security=file.security)


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
    if not location:
        return f"{path}: {first['msg'].removeprefix('Value error, ')}"
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
        kind = next((part for part in typing.get_args(kind) if part is not type(None)), kind)
    if dataclasses.is_dataclass(kind):
        return [field.name for field in dataclasses.fields(kind)]
    return list(getattr(kind, "model_fields", {}))
