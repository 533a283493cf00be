"""Zenoh's log, which it writes to standard output and to nothing else, as a stream that this process reads itself."""

from __future__ import annotations

import contextlib
import fcntl
import os
import select
from collections.abc import Callable, Iterator

import zenoh

_PIECE = 1 << 16
_ROOM = 1 << 20
"""Of the pipe: what is logged while this process is not scheduled."""


@contextlib.contextmanager
def captured(log_filter: str) -> Iterator[Callable[[float], bytes]]:
    """Takes what Zenoh logs from here to the end of the block; the function waits so many seconds for a piece of it.

    Standard output is nothing else's meanwhile, and is closed at the end: Zenoh would wait for a reader for good.
    """
    source, sink = os.pipe()
    with contextlib.suppress(OSError):  # more than this user may have: then it is as large as it is
        fcntl.fcntl(sink, fcntl.F_SETPIPE_SZ, _ROOM)
    os.dup2(sink, 1)
    os.close(sink)
    zenoh.init_log_from_env_or(log_filter)

    def piece(seconds: float) -> bytes:
        readable, _, _ = select.select([source], [], [], seconds)
        return os.read(source, _PIECE) if readable else b""

    try:
        yield piece
    finally:
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, 1)
        os.close(nowhere)
        os.close(source)
