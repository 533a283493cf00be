"""The server: tornado's loop in a thread of its own."""

from __future__ import annotations

import asyncio
import logging
import ssl
import threading
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import structlog
import tornado.httpserver
import tornado.netutil
import tornado.web

from services.console.page import Page
from services.console.web.handlers import Action, Context, Data, Files, Login, Root, Shown, Stop
from services.console.web.socket import MESSAGE_BYTES, Socket

UPLOAD_BYTES = 24 * 1024 * 1024
_HEADER_BYTES = 32 * 1024
_PING_S = 5.0
_RETRY_S = 2.0
_WORKERS = 16

COMMON = Path(__file__).parent.parent / "static"
TEMPLATES = Path(__file__).parent.parent / "templates"

log = structlog.get_logger()


class ToLog(logging.Handler):
    """What tornado complains of, as handshakes that failed, in this project's log."""

    def emit(self, record: logging.LogRecord) -> None:
        """One line."""
        log.warning("web", reason=record.getMessage())


def executors() -> tuple[ThreadPoolExecutor, ThreadPoolExecutor]:
    """Threads for what waits for the bus, and others for the emergency stop."""
    return ThreadPoolExecutor(_WORKERS, "action"), ThreadPoolExecutor(2, "stop")


class Server:
    """Serves pages at an address until it is told to stop; all but :meth:`feed` happens in its own thread."""

    def __init__(self, context: Context, host: str, port: int, tls: ssl.SSLContext | None = None) -> None:
        self._context = context
        self._host, self._port, self._tls = host, port, tls
        self._sockets: set[Socket] = set()
        self._loop: asyncio.AbstractEventLoop | None = None

    def run(self, stop: threading.Event) -> None:
        """Serves until ``stop`` is set; while the port is in use, it is tried again and again."""
        asyncio.run(self._serve(stop))

    def feed(self) -> None:
        """Has every browser sent what it does not know yet; from any thread."""
        loop = self._loop
        if loop is not None and not loop.is_closed():
            loop.call_soon_threadsafe(self._feed)

    def _feed(self) -> None:
        for socket in tuple(self._sockets):
            socket.feed()

    async def _serve(self, stop: threading.Event) -> None:
        self._loop = asyncio.get_running_loop()
        logger = logging.getLogger("tornado")
        logger.propagate = False
        logger.handlers = [ToLog(logging.WARNING)]
        server = tornado.httpserver.HTTPServer(
            application(self._context, self._sockets),
            ssl_options=self._tls,
            max_body_size=UPLOAD_BYTES,
            max_buffer_size=UPLOAD_BYTES,
            max_header_size=_HEADER_BYTES,
            idle_connection_timeout=300,
        )
        if not await self._listen(server, stop):
            return
        await asyncio.to_thread(stop.wait)
        server.stop()
        for socket in tuple(self._sockets):
            socket.close(1001, "the console ends")

    async def _listen(self, server: tornado.httpserver.HTTPServer, stop: threading.Event) -> bool:
        """Opens the port; False where the stop came first."""
        while not stop.is_set():
            try:
                server.add_sockets(tornado.netutil.bind_sockets(self._port, self._host))
            except OSError as error:
                log.error(  # noqa: TRY400, the sentence is meant for a person
                    "the page cannot be served: is the port in use by another program?",
                    host=self._host,
                    port=self._port,
                    reason=error.strerror,
                )
                await asyncio.to_thread(stop.wait, _RETRY_S)
            else:
                return True
        return False


def application(context: Context, sockets: set[Socket]) -> tornado.web.Application:
    """Every address of the console."""
    shared = {"context": context}
    return tornado.web.Application(
        [
            (r"/", Root, shared),
            (r"/login", Login, shared),
            (r"/static/common/(.*)", Files, {"context": context, "path": str(COMMON)}),
            *_files(context, tuple(context.pages.values())),
            (r"/ws/([a-z]+)", Socket, {"context": context, "sockets": sockets}),
            (r"/data/([a-z]+)/(.*)", Data, shared),
            (r"/do/([a-z]+)/([a-z_]+)", Action, shared),
            (r"/(stop|reset)", Stop, shared),
            (r"/([a-z]+)", Shown, shared),
        ],
        template_path=str(TEMPLATES),
        websocket_max_message_size=MESSAGE_BYTES,
        websocket_ping_interval=_PING_S,
        log_function=lambda _handler: None,
    )


def _files(context: Context, pages: Sequence[Page]) -> list[tuple[str, type[Files], dict[str, object]]]:
    return [(rf"/static/{page.name}/(.*)", Files, {"context": context, "path": str(page.folder)}) for page in pages]
