"""The syncer on the bus: its questions, its status, and what it hears of routes and of commits."""

from __future__ import annotations

import threading

from common import topics
from common.messages import Announcement, Done, FetchRequest, PushRequest, Route
from common.service import Service
from services.mapstore.errors import StoreError
from services.mapstore.sync.engine import Syncer

_STATUS_S = 1.0
_ANNOUNCE_S = 2.0


class NotShared(StoreError):
    """Asked of a robot that has no storage to share with."""


def run_sync(service: Service, syncer: Syncer) -> None:
    """Serves the syncer's questions and starts its threads."""
    service.bus.serve(topics.FETCH, lambda request: _fetch(syncer, request))
    service.bus.serve(topics.PUSH, lambda request: _push(syncer, request))
    service.thread(syncer.upload, "uploads")
    service.thread(syncer.fetch, "fetches")
    service.thread(lambda: _publish(service, syncer), "sync status")


def refuse_sync(service: Service) -> None:
    """Answers for a robot whose configuration names no storage."""

    def refuse(_question: FetchRequest | PushRequest) -> Done:
        raise NotShared("this robot shares no maps: name the fleet's storage as 'endpoint' in [mapstore.sync]")

    service.bus.serve(topics.FETCH, refuse)
    service.bus.serve(topics.PUSH, refuse)


class Announce:
    """A question to the server, whose answer nobody needs; where no fleet is linked, nothing."""

    def __init__(self, service: Service) -> None:
        self._bus = service.bus
        self._linked = service.config.bus.fleet is not None

    def __call__(self, announcement: Announcement) -> None:
        """Tells it.

        Raises:
            BusError: the server does not answer; it finds what is new by itself, only later.
        """
        if self._linked:
            self._bus.ask(topics.ANNOUNCE, announcement, _ANNOUNCE_S, name=announcement.environment)


def _fetch(syncer: Syncer, request: FetchRequest) -> Done:
    return Done(text=syncer.want(request))


def _push(syncer: Syncer, request: PushRequest) -> Done:
    return Done(text=syncer.push(request))


def _publish(service: Service, syncer: Syncer) -> None:
    """The status on every change, a few times a second at most, and each second while anything moves."""
    publisher = service.bus.publisher(topics.SYNC_STATUS)
    routes = service.bus.subscribe(topics.ROUTE)
    changed: threading.Event = syncer.transfers.changed
    while not service.stop.is_set():
        changed.wait(_STATUS_S)
        if (route := routes.poll()) is not None:
            syncer.use(_maps_of(route.message))
        if changed.is_set() or syncer.transfers.busy():
            changed.clear()
            publisher.put(syncer.status())
            service.stop.wait(_STATUS_S / 5)


def _maps_of(route: Route) -> list[str]:
    return [*route.maps, *route.plan]
