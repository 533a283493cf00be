"""The register: every certificate that the fleet's authority has issued, and which of them count."""

from __future__ import annotations

from collections import defaultdict
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Self

from pydantic import AfterValidator, BaseModel, ConfigDict, ValidationError

from common.access.names import CommonName, Role
from common.errors import ConfigurationError

FILE = "register.json"


def _common_name(text: str) -> str:
    CommonName.parse(text)
    return text


def _with_zone(moment: datetime) -> datetime:
    if moment.tzinfo is None:
        raise ValueError("a time without its zone")
    return moment


Moment = Annotated[datetime, AfterValidator(_with_zone)]


class Entry(BaseModel):
    """A certificate: its common name, its serial number in hexadecimal digits, and for how long it counts."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    common_name: Annotated[str, AfterValidator(_common_name)]
    serial: str
    expires: Moment
    revoked: Moment | None = None

    @property
    def name(self) -> CommonName:
        """The common name's parts."""
        return CommonName.parse(self.common_name)

    def counts(self, now: datetime) -> bool:
        """Whether it is neither revoked nor expired."""
        return self.revoked is None and now < self.expires


class Register(BaseModel):
    """All certificates, oldest first."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    certificates: tuple[Entry, ...] = ()

    @classmethod
    def read(cls, path: Path) -> Self:
        """The register in a file.

        Raises:
            ConfigurationError: it cannot be read, or is none.
        """
        try:
            return cls.model_validate_json(path.read_bytes())
        except OSError as error:
            raise ConfigurationError(f"cannot read the register of certificates {path}: {error.strerror}") from None
        except ValidationError as error:
            first = error.errors(include_url=False, include_input=False)[0]
            where = ".".join(map(str, first["loc"])) or "the file"
            raise ConfigurationError(f"{path} is no register of certificates: {where}: {first['msg']}") from None

    def of(self, owner: str) -> tuple[Entry, ...]:
        """The certificates of one owner."""
        return tuple(entry for entry in self.certificates if entry.name.owner == owner)

    def common_names(self, now: datetime | None = None) -> dict[Role, dict[str, list[str]]]:
        """By role and owner, the common names that count now."""
        moment = now or datetime.now(UTC)
        found: dict[Role, dict[str, list[str]]] = defaultdict(lambda: defaultdict(list))
        for entry in self.certificates:
            if entry.counts(moment):
                found[entry.name.role][entry.name.owner].append(entry.common_name)
        return {role: dict(owners) for role, owners in found.items()}
