"""Which robots may write: those that are named or have a certificate, less those that have lost theirs."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import structlog

from common.access.names import Role
from common.access.register import Register
from common.access.watch import Watch
from common.config import RobotConfig
from common.errors import ConfigurationError

log = structlog.get_logger()


class Robots:
    """The robots as they were read at the start, and whether they are others by now.

    Attributes:
        names: in alphabetical order.
    """

    def __init__(self, named: Sequence[str], configuration: RobotConfig) -> None:
        """Reads the register that ``[security]`` names.

        Raises:
            ConfigurationError: it cannot be read.
        """
        security = configuration.security
        members = None if security is None else security.members
        self._named = named
        self._register = None if members is None else configuration.beside(members)
        self._watch = Watch([] if self._register is None else [self._register])
        self.names = robots_of(named, self._register)

    def changed(self) -> bool:
        """Whether others may write now; a register that cannot be read changes nothing."""
        if not self._watch.changed():
            return False
        try:
            return robots_of(self._named, self._register) != self.names
        except ConfigurationError as error:
            log.error("the register cannot be used, what was read before still holds", reason=str(error))  # noqa: TRY400
            return False


def robots_of(named: Sequence[str], register: Path | None) -> list[str]:
    """The robots that may write, given those that the configuration names and the register of certificates.

    Raises:
        ConfigurationError: the register cannot be read.
    """
    if register is None:
        return sorted(named)
    read = Register.read(register)
    known = {entry.name.owner for entry in read.certificates if entry.name.role is Role.ROBOT}
    valid = set(read.common_names().get(Role.ROBOT, {}))
    return sorted((set(named) - known) | valid)
