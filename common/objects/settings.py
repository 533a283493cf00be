"""How the object storage is reached."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field, StringConstraints, ValidationError

from common.errors import ConfigurationError

_READABLE_BY_OTHERS = 0o077


class Credentials(BaseModel):
    """A JSON file with ``access_key`` and ``secret_key``."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    access_key: Annotated[str, StringConstraints(min_length=1, max_length=256)]
    secret_key: Annotated[str, StringConstraints(min_length=1, max_length=256)]


@dataclass(frozen=True, slots=True)
class StorageSettings:
    """The fleet's object storage, as a table of a TOML file names it; paths begin at that file's folder.

    Attributes:
        endpoint: ``http://host:port`` or ``https://host:port``; empty where there is none.
        credentials: a JSON file with ``access_key`` and ``secret_key``, for its owner's eyes alone.
        ca: a PEM file with the authority that signed the storage's certificate; by default the system's.
        region: as the storage calls it.
        maps, environments: the two buckets.
        connect_s, answer_s: how long a connection, and each part of an answer, is waited for, seconds.
    """

    endpoint: Annotated[str, Field(pattern=r"^(https?://[^/\s]+)?$")] = ""
    credentials: Path = Path("credentials.json")
    ca: Path | None = None
    region: str = "us-east-1"
    maps: Annotated[str, Field(min_length=3)] = "maps"
    environments: Annotated[str, Field(min_length=3)] = "environments"
    connect_s: Annotated[float, Field(gt=0, le=60)] = 3.0
    answer_s: Annotated[float, Field(gt=0, le=600)] = 20.0

    @property
    def host(self) -> str:
        """The endpoint without its scheme."""
        return re.sub(r"^https?://", "", self.endpoint)

    @property
    def secure(self) -> bool:
        """Whether TLS is spoken."""
        return self.endpoint.startswith("https://")


def read_credentials(path: Path) -> Credentials:
    """The credentials in a file.

    Raises:
        ConfigurationError: it cannot be read, holds none, or others than its owner may read it.
    """
    try:
        content = path.read_bytes()
        mode = path.stat().st_mode
    except OSError as error:
        raise ConfigurationError(f"cannot read the storage's credentials {path}: {error.strerror}") from None
    if mode & _READABLE_BY_OTHERS:
        raise ConfigurationError(f"others may read the storage's credentials {path}: chmod 600 it")
    try:
        return Credentials.model_validate_json(content)
    except ValidationError as error:
        first = error.errors(include_url=False, include_input=False)[0]
        where = ".".join(map(str, first["loc"])) or "the file"
        raise ConfigurationError(f"{path} holds no credentials: {where}: {first['msg']}") from None
