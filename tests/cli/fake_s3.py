"""A web server that behaves towards a client of S3 as one is told to; it keeps nothing and checks no signature."""

from __future__ import annotations

import threading
from email.utils import formatdate
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from time import time
from typing import Self


class FakeS3:
    """Answers puts; honours conditions or does not; its clock is ``ahead`` seconds off. A context manager."""

    def __init__(self, *, conditional: bool = True, ahead: float = 0.0, status: int = 200) -> None:
        there: set[str] = set()

        class Handler(BaseHTTPRequestHandler):
            def do_PUT(self) -> None:
                self.rfile.read(int(self.headers.get("Content-Length", 0)))
                name = self.path.partition("?")[0]
                refused = conditional and "If-None-Match" in self.headers and name in there
                there.add(name)
                self._answer(412 if refused else status)

            def do_HEAD(self) -> None:
                self._answer(403)

            def _answer(self, status: int) -> None:
                self.send_response(status)
                self.send_header("Content-Length", "0")
                self.end_headers()

            def date_time_string(self, timestamp: float | None = None) -> str:
                return formatdate((time() if timestamp is None else timestamp) + ahead, usegmt=True)

            def log_message(self, *_: object) -> None:
                pass

        self._server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)

    def __enter__(self) -> Self:
        threading.Thread(target=self._server.serve_forever, daemon=True).start()
        return self

    def __exit__(self, *_error: object) -> None:
        self._server.shutdown()
        self._server.server_close()

    @property
    def endpoint(self) -> str:
        return f"http://127.0.0.1:{self._server.server_port}"
