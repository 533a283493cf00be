"""HTTP: pages, their files, login, and commands for those without a WebSocket."""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import structlog
import tornado.ioloop
import tornado.web

from common.errors import RetraverseError
from services.console.channel import encode
from services.console.guard import Guard, Guesses
from services.console.page import Page

T = TypeVar("T")

COOKIE = "vtr_session"
_MONTH_DAYS = 30
_HEADERS = {
    "Content-Security-Policy": "default-src 'self'; img-src 'self' blob: data:; style-src 'self' 'unsafe-inline'; "
    "frame-ancestors 'none'; base-uri 'none'; form-action 'self'",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cache-Control": "no-cache",
}

log = structlog.get_logger()


@dataclass(frozen=True, slots=True)
class Context:
    """What the handlers share.

    ``stop`` carries out the emergency stop, or its reset, and returns what came of it; None where there is no robot.
    ``urgent`` runs it, so that it never waits behind what ``workers`` do.
    """

    pages: dict[str, Page]
    guard: Guard
    guesses: Guesses
    workers: Executor
    urgent: Executor
    stop: Callable[[bool], str] | None
    title: str
    secure: bool = False


class Guarded(tornado.web.RequestHandler):
    """A handler that nobody reaches who may not."""

    context: Context

    def initialize(self, context: Context) -> None:
        """Tornado's constructor."""
        self.context = context

    def set_default_headers(self) -> None:
        """Nothing from elsewhere is loaded, and no other page frames this one."""
        for name, value in _HEADERS.items():
            self.set_header(name, value)

    def prepare(self) -> None:
        """Refuses foreign hosts and origins, and whoever does not know the token."""
        if reason := self.foreign():
            self.refuse(403, reason)
        elif not self.known():
            self.ask_for_token()

    def foreign(self) -> str:
        """Why a request comes from where it may not; empty where it may."""
        guard, host = self.context.guard, self.request.host
        if not guard.allows_host(host):
            return f"the console is not called '{host}'"
        origin = self.request.headers.get("Origin")
        if not guard.allows_origin(origin, host):
            return f"pages of '{origin}' may not use this console"
        return ""

    def known(self) -> bool:
        """Whether the browser has a session, or the program a token; a wrong token is remembered."""
        guard = self.context.guard
        if guard.token is None or guard.knows_session(self.get_cookie(COOKIE) or ""):
            return True
        scheme, _, token = self.request.headers.get("Authorization", "").partition(" ")
        return scheme.lower() == "bearer" and self.right(token.strip())

    def right(self, token: str) -> bool:
        """Whether a token is right; an address that guesses is made to wait, and not even answered meanwhile."""
        address, now = self.request.remote_ip or "", time.monotonic()
        guesses = self.context.guesses
        if (wait := guesses.wait(address, now)) > 0:
            self.set_header("Retry-After", str(round(wait + 0.5)))
            self.refuse(429, f"too many wrong tokens: wait {wait:.1f} s")
            return False
        if self.context.guard.knows_token(token):
            guesses.right(address)
            return True
        guesses.wrong(address, now)
        log.warning("a wrong token", address=address, path=self.request.path)
        return False

    def ask_for_token(self) -> None:
        """Refuses for want of a token."""
        if not self._finished:
            self.refuse(401, "the console needs its token")

    def refuse(self, status: int, reason: str) -> None:
        """Ends the request with a sentence, and logs it."""
        log.warning("refused", status=status, reason=reason, address=self.request.remote_ip, path=self.request.path)
        self.set_status(status)
        self.set_header("Content-Type", "text/plain; charset=utf-8")
        self.finish(reason)

    def log_exception(self, *error: Any) -> None:  # noqa: ANN401, tornado's signature
        """A defect goes to this project's log."""
        if not isinstance(error[1], tornado.web.HTTPError):
            log.error("a request failed", path=self.request.path, exc_info=error)

    def write_error(self, status_code: int, **_: Any) -> None:  # noqa: ANN401, tornado's signature
        """One sentence, no traceback."""
        self.set_header("Content-Type", "text/plain; charset=utf-8")
        self.finish(f"{status_code}: {self._reason}")

    async def aside(self, work: Callable[[], T], executor: Executor | None = None) -> T:
        """Does work in a thread."""
        loop = tornado.ioloop.IOLoop.current()
        return await loop.run_in_executor(executor or self.context.workers, work)

    async def answer(self, work: Callable[[], object], executor: Executor | None = None) -> None:
        """Does what was asked for in a thread, and answers with what came of it."""
        try:
            told: dict[str, object] = {"ok": True, "told": await self.aside(work, executor)}
        except RetraverseError as error:
            self.set_status(409)
            told = {"ok": False, "told": str(error)}
        self.set_header("Content-Type", "application/json; charset=utf-8")
        self.finish(encode(told))


class ForPeople(Guarded):
    """What a person types into the address bar."""

    def ask_for_token(self) -> None:
        """Leads to where it can be given."""
        if not self._finished:
            self.redirect("/login")


class Root(ForPeople):
    """``/``: the first page."""

    def get(self) -> None:
        """Leads there."""
        self.redirect(f"/{next(iter(self.context.pages))}")


class Shown(ForPeople):
    """A page in the common frame."""

    async def get(self, name: str) -> None:
        """The page's HTML."""
        page = self.context.pages.get(name)
        if page is None:
            raise tornado.web.HTTPError(404)
        self.render(
            "frame.html",
            page=page,
            pages=self.context.pages.values(),
            body=await self.aside(lambda: _text(page.folder / "page.html")),
            title=self.context.title,
            stoppable=self.context.stop is not None,
            session=self.context.guard.token is not None,
        )


class Login(Guarded):
    """Where a person gives the token."""

    def prepare(self) -> None:
        """Anybody of this origin may come here."""
        if reason := self.foreign():
            self.refuse(403, reason)

    def get(self) -> None:
        """The form."""
        self.render("login.html", title=self.context.title, reason="")

    def post(self) -> None:
        """A session for whoever knows the token."""
        if self.right(self.get_body_argument("token", "").strip()):
            self.set_cookie(
                COOKIE,
                self.context.guard.session(),
                expires_days=_MONTH_DAYS,
                httponly=True,
                samesite="Strict",
                secure=self.context.secure or self.request.protocol == "https",
            )
            self.redirect("/")
        elif not self._finished:
            self.set_status(401)
            self.render("login.html", title=self.context.title, reason="This is not the console's token.")


class Files(tornado.web.StaticFileHandler, Guarded):
    """Static files: read from the package alone, and checked anew at each request."""

    def initialize(self, context: Context, path: str) -> None:  # type: ignore[override]
        """The folder that they are in."""
        Guarded.initialize(self, context)
        tornado.web.StaticFileHandler.initialize(self, path)

    def prepare(self) -> None:
        """As every other request; the style of the login page is for all."""
        if reason := self.foreign():
            self.refuse(403, reason)
        elif not self.request.path.startswith("/static/common/") and not self.known():
            self.ask_for_token()


class Data(Guarded):
    """What a page hands out and takes beside its channel."""

    async def get(self, name: str, path: str) -> None:
        """Bytes."""
        page = self._page(name)
        found = await self.aside(lambda: page.resource(path))
        if found is None:
            raise tornado.web.HTTPError(404)
        self.set_header("Content-Type", found.kind)
        self.finish(found.body)

    async def post(self, name: str, path: str) -> None:
        """An upload."""
        page, body = self._page(name), self.request.body
        await self.answer(lambda: page.store(path, body))

    def _page(self, name: str) -> Page:
        if name not in self.context.pages:
            raise tornado.web.HTTPError(404)
        return self.context.pages[name]


class Action(Guarded):
    """A page's action by HTTP, for programs."""

    async def post(self, name: str, action: str) -> None:
        """Carries it out; the arguments are the JSON object of the body."""
        page = self.context.pages.get(name)
        if page is None:
            raise tornado.web.HTTPError(404)
        try:
            arguments = json.loads(self.request.body or b"{}")
        except (ValueError, RecursionError):
            arguments = None
        if not isinstance(arguments, dict):
            self.refuse(400, "the body is no JSON object")
            return
        await self.answer(lambda: page.act(action, arguments))


class Stop(Guarded):
    """The emergency stop, and its reset: of every page, by HTTP, so that it needs no WebSocket."""

    async def post(self, what: str) -> None:
        """Stops the robot at once, or lets the latch go."""
        stop = self.context.stop
        if stop is None:
            raise tornado.web.HTTPError(404)
        await self.answer(lambda: stop(what == "reset"), self.context.urgent)


def _text(path: Path) -> str:
    return path.read_text(encoding="utf-8")
