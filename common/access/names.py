"""The common name of a certificate: what it is for, whose it is, and which one of that owner's: ``robot.r1.5f3a9c21``.

Zenoh tells certificates apart by their common names alone. So each certificate has one of its own, and revoking it is
taking its name from the list of those that may do anything.
"""

from __future__ import annotations

import re
import secrets
from dataclasses import dataclass
from enum import StrEnum
from typing import Self

from common.ids import NAME_PATTERN

_FORM = re.compile(rf"(?P<role>[a-z]+)\.(?P<owner>{NAME_PATTERN[1:-1]})\.(?P<issue>[0-9a-f]{{8}})")


class Role(StrEnum):
    """What a certificate is for."""

    SERVER = "server"
    ROBOT = "robot"
    OPERATOR = "operator"
    VIEWER = "viewer"


@dataclass(frozen=True, slots=True)
class CommonName:
    """The parts of a certificate's common name; ``issue`` is eight hexadecimal digits by chance."""

    role: Role
    owner: str
    issue: str

    def __str__(self) -> str:
        return f"{self.role}.{self.owner}.{self.issue}"

    @classmethod
    def new(cls, role: Role, owner: str) -> Self:
        """The name of a new certificate."""
        return cls(role, owner, secrets.token_hex(4))

    @classmethod
    def parse(cls, text: str) -> Self:
        """The parts of a name.

        Raises:
            ValueError: it is none of this form.
        """
        match = _FORM.fullmatch(text)
        if match is None:
            raise ValueError(f"{text!a} is no common name of this fleet: it is written as role.owner.issue")
        return cls(Role(match["role"]), match["owner"], match["issue"])
