"""A browser's WebSocket: what a page shows goes out, what its operator wants comes in."""

from __future__ import annotations

import itertools
import json
from asyncio import Future
from typing import Any

import structlog
import tornado.ioloop
import tornado.websocket

from common.errors import RetraverseError
from services.console.channel import encode
from services.console.page import Page
from services.console.web.handlers import Context, Guarded

MESSAGE_BYTES = 64 * 1024
"""Longer than anything that a page sends."""

MOST = 100
"""Pages that are open at the same time."""

_AT_ONCE = 8
"""Actions of one browser that may wait for an answer at the same time."""

_TOO_BIG, _NONSENSE = 1009, 1007

log = structlog.get_logger()


class Socket(tornado.websocket.WebSocketHandler, Guarded):
    """One browser that looks at one page.

    It is sent what changed since it was last sent something, and only when that has left: one that is slow misses what
    was in between, and delays nobody.
    """

    _numbers = itertools.count(1)

    def initialize(self, context: Context, sockets: set[Socket]) -> None:  # type: ignore[override]
        """Remembers whom it belongs to."""
        Guarded.initialize(self, context)
        self.number = next(self._numbers)
        self._sockets = sockets
        self._page: Page | None = None
        self._revision = 0
        self._seen: dict[str, int] = {}
        self._sending: Future[None] | None = None
        self._visible = True
        self._acting = 0

    def check_origin(self, origin: str) -> bool:
        """The guard has judged it before."""
        return self.context.guard.allows_origin(origin, self.request.host)

    def get_websocket_protocol(self) -> tornado.websocket.WebSocketProtocol | None:
        """Tornado's, which ends a connection by an oversized message before it is read, and tells nobody."""
        protocol = super().get_websocket_protocol()
        if protocol is not None:
            close = protocol.close

            def close_and_tell(code: int | None = None, reason: str | None = None) -> None:
                if code == _TOO_BIG:
                    self._tell_refused(f"a message of more than {MESSAGE_BYTES} bytes")
                close(code, reason)

            protocol.close = close_and_tell  # type: ignore[method-assign]
        return protocol

    async def get(self, *args: Any, **kwargs: Any) -> None:  # noqa: ANN401, tornado's signature
        """The handshake, for a page that there is."""
        self._page = self.context.pages.get(args[0])
        if self._page is None:
            self.refuse(404, f"there is no page '{args[0]}'")
            return
        if len(self._sockets) >= MOST:
            self.refuse(503, f"{MOST} pages are open already")
            return
        await tornado.websocket.WebSocketHandler.get(self, *args, **kwargs)

    def open(self, *_args: str, **_kwargs: str) -> None:
        """The browser's number, and all that the page shows now."""
        self.set_nodelay(True)
        self._sockets.add(self)
        self._count()
        self._write(encode({"you": self.number}))
        self.feed()

    def on_close(self) -> None:
        """The browser has gone."""
        self._sockets.discard(self)
        self._count()
        if self._page is not None:
            self._page.left(self.number)

    def feed(self) -> None:
        """Sends what the browser does not know yet, unless something is still on its way to it."""
        if self._page is None or not self._visible or (self._sending is not None and not self._sending.done()):
            return
        self._revision, text = self._page.channel.since(self._revision)
        if text is not None:
            self._sending = self._write(text)
        for name, picture in self._page.channel.pictures().items():
            if self._seen.get(name) != picture.number:
                self._seen[name] = picture.number
                self._sending = self._write(picture.payload)

    def on_message(self, message: str | bytes) -> None:
        """A wish of the browser's; nonsense ends the connection."""
        try:
            wish = json.loads(message)
        except (ValueError, RecursionError):
            wish = None
        if not isinstance(wish, dict):
            self._end(_NONSENSE, "a message that is no JSON object")
        elif "visible" in wish:
            self._visible = bool(wish["visible"])
            self._count()
            self.feed()
        elif "do" in wish:
            tornado.ioloop.IOLoop.current().add_callback(self._act, wish)
        elif self._page is not None:
            self._page.hear(self.number, wish)

    async def _act(self, wish: dict[str, Any]) -> None:
        """Carries out an action in a thread and answers it."""
        arguments = wish.get("with", {})
        if self._page is None or not isinstance(arguments, dict) or self._acting >= _AT_ONCE:
            self._answer(wish, ok=False, told="the console cannot take this now")
            return
        page, action = self._page, str(wish["do"])
        self._acting += 1
        try:
            told = await self.aside(lambda: page.act(action, arguments))
            self._answer(wish, ok=True, told=told)
        except RetraverseError as error:
            self._answer(wish, ok=False, told=str(error))
        except Exception:
            log.exception("an action failed", page=page.name, action=action)
            self._answer(wish, ok=False, told="the console could not do this; its log says why")
        finally:
            self._acting -= 1

    def _answer(self, wish: dict[str, Any], *, ok: bool, told: object) -> None:
        self._write(encode({"re": wish.get("id"), "ok": ok, "told": told}))

    def _write(self, message: str | bytes) -> Future[None] | None:
        try:
            sending = self.write_message(message, binary=isinstance(message, bytes))
        except tornado.websocket.WebSocketClosedError:
            return None
        # A browser that goes in the middle of it is no error: on_close tells.
        sending.add_done_callback(lambda sent: sent.cancelled() or sent.exception())
        return sending

    def _end(self, code: int, reason: str) -> None:
        self._tell_refused(reason)
        self.close(code, reason[:120])

    def _tell_refused(self, reason: str) -> None:
        log.warning("refused", reason=reason, address=self.request.remote_ip, path=self.request.path)

    def _count(self) -> None:
        if self._page is not None:
            self._page.channel.watchers = sum(1 for one in self._sockets if one.looks_at(self._page))

    def looks_at(self, page: Page) -> bool:
        """Whether the browser shows this page, and in a tab that can be seen."""
        return self._page is page and self._visible
