"""What systemd is told by a process that it started: ready, still alive, stopping (``sd_notify(3)``).

Under anything else every call does nothing: the address is in the environment of systemd's own services alone.
"""

from __future__ import annotations

import os
import socket
from collections.abc import Mapping

_MICROSECONDS = 1_000_000


class ServiceManager:
    """The socket of systemd's service manager, where there is one."""

    def __init__(self, environment: Mapping[str, str] = os.environ) -> None:
        address = environment.get("NOTIFY_SOCKET", "")
        # An address that begins with "@" is in Linux's abstract namespace.
        self._address = "\0" + address[1:] if address.startswith("@") else address
        self.watchdog_s = _watchdog_s(environment)
        """Seconds without a sign of life after which systemd kills this process; None where it does not watch."""

    def ready(self) -> None:
        """The start is over, and whoever waits for this process may go on."""
        self._tell("READY=1")

    def alive(self) -> None:
        """A sign of life, which starts the watchdog's time anew."""
        if self.watchdog_s is not None:
            self._tell("WATCHDOG=1")

    def stopping(self) -> None:
        """The end has begun."""
        self._tell("STOPPING=1")

    def says(self, status: str) -> None:
        """One line on what the process does, for ``systemctl status``."""
        self._tell(f"STATUS={' '.join(status.split())}")

    def _tell(self, line: str) -> None:
        if not self._address:
            return
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_CLOEXEC) as teller:
            teller.setblocking(False)
            try:
                teller.connect(self._address)
                teller.send(line.encode())
            except OSError:
                # Nobody listens, or not now: the next sign of life is a second away, and no robot stops for a word.
                return


def _watchdog_s(environment: Mapping[str, str]) -> float | None:
    """The watchdog's interval where it is this process that is watched, not the one that it inherited from."""
    if environment.get("WATCHDOG_PID", str(os.getpid())) != str(os.getpid()):
        return None
    microseconds = environment.get("WATCHDOG_USEC", "")
    return int(microseconds) / _MICROSECONDS if microseconds.isdigit() and int(microseconds) > 0 else None
