"""What the storage refuses: SeaweedFS tells of each request in Fluentd's forward protocol, to this process."""

from __future__ import annotations

import contextlib
import json
import socket
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import msgpack
import structlog

from common.files import write_private
from common.limit import Limit
from common.service import Service

_REFUSED = (401, 403)
_MOST_BYTES = 1 << 20
_POLL_S = 0.2
_PERIOD_S = 1.0
_LINES = 20
_OPERATION = "REST."

log = structlog.get_logger()


class Refusal(NamedTuple):
    """A request that was not the requester's right; ``who`` is empty where it could not show who it was."""

    who: str
    what: str
    key: str
    reason: str


class Audit:
    """Listens on loopback for as long as the service runs, and logs each refusal."""

    def __init__(self, service: Service, folder: Path) -> None:
        """Opens the port and writes the file that names it to SeaweedFS."""
        self._service = service
        self._limit = Limit(_PERIOD_S, _LINES)
        self._server = socket.create_server(("127.0.0.1", 0))
        self._server.settimeout(_POLL_S)
        self.file = folder / "audit.json"
        host, port = self._server.getsockname()
        target = {"fluent_host": host, "fluent_port": port, "fluent_network": "tcp", "tag_prefix": "s3"}
        write_private(self.file, json.dumps(target))

    def run(self) -> None:
        """One connection after the other: SeaweedFS has one."""
        with self._server:
            while not self._service.stop.is_set():
                with contextlib.suppress(TimeoutError):
                    connection, _ = self._server.accept()
                    with connection:
                        self._read(connection)

    def _read(self, connection: socket.socket) -> None:
        connection.settimeout(_POLL_S)
        unpacker = msgpack.Unpacker(raw=False, unicode_errors="replace", max_buffer_size=_MOST_BYTES)
        while not self._service.stop.is_set():
            try:
                piece = connection.recv(1 << 16)
            except TimeoutError:
                continue
            except OSError:
                return
            if not piece:
                return
            try:
                unpacker.feed(piece)
                for refusal in refusals(unpacker):
                    self._log(refusal)
            except (ValueError, msgpack.UnpackException) as error:
                log.warning("what the storage tells of its requests cannot be read", reason=str(error))
                return

    def _log(self, refusal: Refusal) -> None:
        if count := self._limit.passes(refusal, time.monotonic()):
            who = refusal.who or "a stranger"
            log.warning("refused", who=who, what=refusal.what, key=refusal.key, reason=refusal.reason, count=count)


def refusals(messages: Iterator[Any]) -> Iterator[Refusal]:
    """The refusals among Fluentd's messages, each a tag, a time and a record; whatever is none is passed over."""
    for message in messages:
        record = message[2] if isinstance(message, list) and len(message) > 2 else None
        if isinstance(record, dict) and record.get("status") in _REFUSED:
            what = str(record.get("operation", "")).removeprefix(_OPERATION).partition(".")[0].lower()
            key = f"{record.get('bucket', '')}/{record.get('key', '')}"
            yield Refusal(str(record.get("requester", "")), what, key, str(record.get("error_code", "")))
