"""Who is linked to this router, and the end of links whose certificates count no more.

Zenoh has no list of revoked certificates, and no call that closes a link. Access control leaves a revoked certificate
no right; that it does not even stay connected is this module's doing, by shutting the link's socket.
"""

from __future__ import annotations

import contextlib
import os
import re
import socket
import stat
from pathlib import Path

_ADDRESS = re.compile(r"^tls/(?:\[(?P<v6>[^]]+)\]|(?P<v4>[^:]+)):(?P<port>\d+)")
_DESCRIPTORS = Path("/proc/self/fd")


def cut(locator: str) -> bool:
    """Shuts the connection of this process to the other end of a TLS link, as ``tls/127.0.0.1:51328``.

    Returns whether there was one; on systems without ``/proc`` there never is.
    """
    match = _ADDRESS.match(locator)
    if match is None or not _DESCRIPTORS.is_dir():
        return False
    host, port = match["v6"] or match["v4"], int(match["port"])
    descriptors = [int(entry.name) for entry in _DESCRIPTORS.iterdir()]
    return any(_shut(descriptor, host, port) for descriptor in descriptors)


def _shut(descriptor: int, host: str, port: int) -> bool:
    with contextlib.suppress(OSError):  # no socket, not connected, or gone by now
        if not stat.S_ISSOCK(os.fstat(descriptor).st_mode):
            return False
        with socket.socket(fileno=os.dup(descriptor)) as connection:
            peer = connection.getpeername()
            if isinstance(peer, tuple) and _plain(peer[0]) == _plain(host) and peer[1] == port:
                connection.shutdown(socket.SHUT_RDWR)
                return True
    return False


def _plain(host: str) -> str:
    return host.removeprefix("::ffff:")
