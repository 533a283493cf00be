"""The Zenoh router of a robot or of the fleet: lets in whom its configuration names, and logs what it refuses."""

from __future__ import annotations

import queue
import time
from collections import deque
from collections.abc import Callable
from pathlib import Path

import structlog
import zenoh

from common.access.link import DICTIONARY, router_settings
from common.access.register import Register
from common.access.watch import Watch
from common.config import RobotConfig
from common.errors import ConfigurationError
from common.limit import Limit
from common.priority import be_on_time
from common.service import Service
from services.router.capture import captured
from services.router.links import cut
from services.router.refusals import LOG_FILTER, Complaint, Reader, Refusal

_POLL_S = 0.2
_LOG_PERIOD_S = 1.0
_LINES = 50
_COMPLAINT_PERIOD_S = 30.0
_MUTE_S = 2.0
"""A refused link is shut so much later: whoever tries again at once, as every client of ours, waits in the meantime."""

log = structlog.get_logger()


def main(service: Service) -> None:
    """Routes until it is stopped, or until what it was configured by has changed; Zenoh's threads do the work."""
    be_on_time()
    if service.config.security is None:
        service.ready()
        service.stop.wait()
        return
    with captured(LOG_FILTER) as piece:
        Guard(service).run(piece)


class Guard:
    """Logs who comes and what is refused, and ends the links of certificates that do not count."""

    def __init__(self, service: Service) -> None:
        self._service = service
        self._reader = Reader()
        self._refused = Limit(_LOG_PERIOD_S, _LINES)
        self._doomed: deque[tuple[float, str]] = deque()
        self._linked = Limit(_LOG_PERIOD_S, _LINES)
        self._complained = Limit(_COMPLAINT_PERIOD_S, _LINES)
        self._watch = Watch(watched(service.config))
        self._valid = valid_names(service.config)
        self._events: queue.SimpleQueue[zenoh.LinkEvent] = queue.SimpleQueue()

    def run(self, piece: Callable[[float], bytes]) -> None:
        """Reads Zenoh's log as it comes."""
        info = self._service.bus.session.info
        listener = info.declare_link_events_listener(self._events.put, history=True)
        self._service.ready()
        while not self._service.stop.is_set() and not self._changed():
            for found in self._reader.read(piece(_POLL_S)):
                self._log(found)
            while not self._events.empty():
                self._link(self._events.get())
            self._cut(time.monotonic())
        listener.undeclare()  # type: ignore[no-untyped-call]

    def _link(self, event: zenoh.LinkEvent) -> None:
        """A link came, or went; Zenoh may tell of one that was there at the start twice."""
        name, address, now = event.link.auth_identifier, str(event.link.dst), time.monotonic()
        if name is None:
            return
        self._reader.name(str(event.link.zid), name)
        came = event.kind == zenoh.SampleKind.PUT
        if not came:
            self._doomed = deque((when, other) for when, other in self._doomed if other != address)
        if not came or self._valid is None or name in self._valid:
            if self._linked.passes((address, came), now):
                log.info("linked" if came else "link ended", who=name, address=address)
            return
        self._doomed.append((now + _MUTE_S, address))
        if count := self._refused.passes(name, now):
            reason = "the certificate is revoked, expired or not in the register"
            log.warning("refused", who=name, what="link", reason=reason, count=count)

    def _cut(self, now: float) -> None:
        """Ends the links of which it is time."""
        while self._doomed and self._doomed[0][0] <= now:
            address = self._doomed.popleft()[1]
            if not cut(address) and self._complained.passes(address, now):
                log.warning("a refused link stays, without a right to anything", address=address)

    def _log(self, found: Refusal | Complaint) -> None:
        now = time.monotonic()
        if isinstance(found, Complaint):
            if count := self._complained.passes(found, now):
                log.warning("zenoh", text=found.text, count=count)
        elif count := self._refused.passes(found, now):
            told = {"reason" if found.what == "link" else "key": found.key}
            log.warning("refused", who=found.who or "a stranger", what=found.what, count=count, **told)

    def _changed(self) -> bool:
        """Whether certificates, passwords or the register were replaced: Zenoh reads them once, at its start."""
        changed = self._watch.changed()
        if not changed:
            return False
        try:
            router_settings(self._service.config)
        except ConfigurationError as error:
            log.error("what has changed cannot be used, what was read before still holds", reason=str(error))  # noqa: TRY400
            return False
        log.info("ends, to be started anew with what has changed", files=" ".join(map(str, changed)))
        return True


def watched(configuration: RobotConfig) -> list[Path]:
    """The files that a router is started anew for."""
    security = configuration.security
    if security is None:
        return []
    dictionary = security.users and security.users / DICTIONARY
    named = (security.ca, security.certificate, security.key, security.members, dictionary)
    return [configuration.beside(path) for path in named if path is not None]


def valid_names(configuration: RobotConfig) -> frozenset[str] | None:
    """The common names of all certificates that count; None where there is no register to say so.

    Raises:
        ConfigurationError: the register cannot be read.
    """
    security = configuration.security
    if security is None or security.members is None:
        return None
    names = Register.read(configuration.beside(security.members)).common_names()
    return frozenset(name for owners in names.values() for some in owners.values() for name in some)
