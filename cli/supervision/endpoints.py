"""The router's address: whether something answers there, and whether a new router could listen there."""

from __future__ import annotations

import contextlib
import errno
import re
import socket
from dataclasses import dataclass
from typing import Any

from common.errors import ConfigurationError

_TCP = re.compile(r"^(?:tcp|tls)/(?:\[(?P<v6>[^]]+)\]|(?P<host>[^:\[\]]+)):(?P<port>\d{1,5})$")
_UNIX = "unixsock-stream/"


@dataclass(frozen=True, slots=True)
class Address:
    """A socket's family and address, as :mod:`socket` takes them."""

    family: socket.AddressFamily
    address: Any
    endpoint: str

    def answers(self, timeout: float) -> bool:
        """Whether a connection is accepted within ``timeout`` seconds."""
        with socket.socket(self.family, socket.SOCK_STREAM) as probe:
            probe.settimeout(timeout)
            with contextlib.suppress(OSError):
                probe.connect(self.address)
                return True
        return False

    def check_free(self) -> None:
        """Raises unless a router could listen here now.

        Raises:
            ConfigurationError: the address is in use, or is not one of this machine.
        """
        if self.answers(0.5):
            raise ConfigurationError(self._in_use())
        if self.family is socket.AF_UNIX:
            return
        with socket.socket(self.family, socket.SOCK_STREAM) as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            try:
                probe.bind(self.address)
            except OSError as error:
                if error.errno == errno.EADDRINUSE:
                    raise ConfigurationError(self._in_use()) from None
                raise ConfigurationError(f"the router cannot listen at {self.endpoint}: {error.strerror}") from None

    def _in_use(self) -> str:
        return f"{self.endpoint} is in use by another program: stop it, or set another endpoint in [bus]"


def parse(endpoint: str) -> Address:
    """The address of a Zenoh endpoint ``tcp/host:port`` or ``unixsock-stream/path``.

    Raises:
        ConfigurationError: it has another form, or its host has no address.
    """
    locator = re.split(r"[?#]", endpoint, maxsplit=1)[0]
    if locator.startswith(_UNIX):
        return Address(socket.AF_UNIX, locator.removeprefix(_UNIX), endpoint)
    match = _TCP.match(locator)
    if match is None or int(match["port"]) not in range(1, 65536):
        raise ConfigurationError(f"'{endpoint}' is no endpoint for [bus]: write it as tcp/host:port or tls/host:port")
    try:
        found = socket.getaddrinfo(match["v6"] or match["host"], int(match["port"]), type=socket.SOCK_STREAM)
    except socket.gaierror as error:
        raise ConfigurationError(f"the host of {endpoint} has no address: {error.strerror}") from None
    family, _, _, _, address = found[0]
    return Address(family, address, endpoint)
