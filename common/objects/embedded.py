"""The storage that a fleet's server brings along: where it listens, and whose credentials it has made."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from pydantic import Field, StringConstraints

from common.ids import NAME_PATTERN
from common.objects.settings import StorageSettings

SERVER = "server"
"""The name of the server's own credentials."""

Name = Annotated[str, StringConstraints(pattern=NAME_PATTERN)]


@dataclass(frozen=True, slots=True)
class EmbeddedSettings:
    """``[storage]``; paths begin at the configuration's folder.

    Attributes:
        port: where S3 is spoken.
        bind: the address that it listens at; loopback, unless robots come from elsewhere.
        robots: each gets credentials of its own, which may read everything and write below its own prefix.
        certificate, key: PEM files, for TLS.
        ca: a PEM file with who signed the certificate; by default it has signed itself.
    """

    port: Annotated[int, Field(ge=1, le=65535)] = 8333
    bind: str = "127.0.0.1"
    robots: tuple[Name, ...] = ()
    certificate: Path | None = None
    key: Path | None = None
    ca: Path | None = None

    def reached(self, directory: Path, base: Path) -> StorageSettings:
        """How the server reaches it, whose data are in ``directory`` and whose configuration in ``base``."""
        scheme = "http" if self.certificate is None else "https"
        return StorageSettings(
            endpoint=f"{scheme}://{self.bind}:{self.port}",
            credentials=credentials_file(directory, SERVER),
            ca=None if self.certificate is None else base / (self.ca or self.certificate),
        )


def credentials_file(directory: Path, name: str) -> Path:
    """The credentials of a robot, or of the server, below the server's own directory."""
    return directory / "storage" / "credentials" / f"{name}.json"
