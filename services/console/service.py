"""The console on the bus: pages are filled ten or twenty times a second, and a server brings them to browsers."""

from __future__ import annotations

import ssl
import time
from pathlib import Path

import structlog

from common import topics
from common.errors import ConfigurationError
from common.messages import Done, SafetyCommand
from common.service import Service
from services.console import pages
from services.console.guard import Guard, Guesses, read_token, session_secret
from services.console.page import Page
from services.console.settings import Settings
from services.console.web.handlers import Context
from services.console.web.server import Server, executors

_PERIOD_S = 0.1
_WATCHED_S = 0.05
"""Where somebody looks: what arrives ten times a second is shown 25 ms later on average."""

_BEAT_S = 1.0
_STOP_DEADLINE_S = 2.0
_LOG_PERIOD_S = 5.0

log = structlog.get_logger()


def main(service: Service) -> None:
    """Serves the pages until the process is stopped."""
    Console(service).run()


class Console:
    """The pages, the loop that fills them, and the server."""

    def __init__(self, service: Service) -> None:
        self._service = service
        self._settings = service.config.settings("console", Settings)
        self._pages = pages.build(service, self._settings)
        workers, urgent = executors()
        self._context = Context(
            pages={page.name: page for page in self._pages},
            guard=self._guard(),
            guesses=Guesses(),
            workers=workers,
            urgent=urgent,
            stop=None if service.config.of_fleet else self._stop,
            title=service.config.robot.name,
            secure=bool(self._settings.certificate),
        )
        settings = self._settings
        self._server = Server(self._context, settings.host, settings.port, tls_context(settings, service.config.path))
        self._complained = -_LOG_PERIOD_S
        self._beat = -_BEAT_S

    def run(self) -> None:
        """Fills the pages and feeds the browsers; a page that fails stops no other one."""
        stop = self._service.stop
        self._service.thread(lambda: self._server.run(stop), "web")
        self._service.ready()
        log.info("the page is served", address=self._settings.address)
        due = time.monotonic()
        while not stop.wait(max(due - time.monotonic(), 0.0)):
            watched = any(page.channel.watchers for page in self._pages)
            due = max(due + (_WATCHED_S if watched else _PERIOD_S), time.monotonic())
            with self._service.stage("update"):
                self._update_all(time.monotonic())
            self._server.feed()

    def _update_all(self, now: float) -> None:
        beats = now >= self._beat + _BEAT_S
        for page in self._pages:
            if beats:
                page.channel.set("beat", round(now, 2))
            self._update(page, now)
        if beats:
            self._beat = now

    def _update(self, page: Page, now: float) -> None:
        try:
            page.update(now)
        except Exception:
            if now >= self._complained + _LOG_PERIOD_S:
                self._complained = now
                log.exception("a page cannot be filled", page=page.name)

    def _guard(self) -> Guard:
        settings, config = self._settings, self._service.config
        token = read_token(settings.path(settings.token_file, config.path)) if settings.token_file else None
        secret = session_secret(config.directory / "run" / "console.secret")
        return Guard(token, secret, frozenset({settings.host}), frozenset(settings.origins))

    def _stop(self, reset: bool) -> str:  # noqa: FBT001, one switch
        """The emergency stop, straight to safety."""
        command = SafetyCommand(action="reset" if reset else "stop", reason="the console's Stop")
        answer: Done = self._service.bus.ask(topics.SAFETY_COMMAND, command, timeout=_STOP_DEADLINE_S)
        return answer.text


def tls_context(settings: Settings, config: Path) -> ssl.SSLContext | None:
    """What the page is served by over TLS; None where it is served without.

    Raises:
        ConfigurationError: the certificate or its key cannot be used.
    """
    if not settings.certificate:
        return None
    certificate, key = settings.path(settings.certificate, config), settings.path(settings.private_key, config)
    context = ssl.create_default_context(ssl.Purpose.CLIENT_AUTH)
    try:
        context.load_cert_chain(certificate, key)
    except (OSError, ssl.SSLError) as error:
        raise ConfigurationError(f"cannot use the console's certificate {certificate} with {key}: {error}") from None
    return context
