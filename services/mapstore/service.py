"""Serves the map store's questions; lives on when the store cannot be opened, and says why to whoever asks."""

from __future__ import annotations

import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import structlog

from common import topics
from common.messages import Message
from common.service import Service
from services.mapstore.errors import StoreError
from services.mapstore.fleet_link import Announce, refuse_sync, run_sync
from services.mapstore.settings import Settings
from services.mapstore.store import Store
from services.mapstore.sync.engine import Syncer

_CHECKPOINT_PERIOD_S = 0.5
_TO_SHARE = {topics.ENDS, topics.REPORT}
"""What makes something ready to be shared."""

log = structlog.get_logger()


class Keeper:
    """Opens the store when it is first asked for, and tries again at each question until it can."""

    def __init__(self, file: Path, settings: Settings) -> None:
        self._file = file
        self._settings = settings
        self._lock = threading.Lock()
        self._store: Store | None = None
        self._reason = ""

    def store(self) -> Store:
        """The open store.

        Raises:
            StoreError: it cannot be opened; logged once for each reason.
        """
        with self._lock:
            if self._store is None:
                try:
                    self._store = Store(self._file, self._settings)
                except StoreError as error:
                    self._report(str(error))
                    raise
                log.info("the map store is open", file=str(self._file))
            return self._store

    def tidy(self) -> None:
        """Moves the log of an open store to its main file when it has grown."""
        if self._store is None:
            return
        try:
            self._store.checkpoint()
        except StoreError as error:
            self._report(str(error))

    def close(self) -> None:
        """Closes the store if it is open."""
        with self._lock:
            if self._store is not None:
                self._store.close()

    def _report(self, reason: str) -> None:
        if reason != self._reason:
            log.error("the map store fails", reason=reason)
            self._reason = reason


def main(service: Service) -> None:
    """Answers until the service is stopped."""
    settings = service.config.settings("mapstore", Settings)
    keeper = Keeper(service.config.directory / "store" / "maps.sqlite", settings)
    try:
        keeper.store()
    except StoreError:
        log.warning("waiting for the map store to become usable")
    answers: dict[topics.Topic, Callable[[Store, Any], Message]] = {
        topics.COMMIT: Store.commit,
        topics.MAPS: Store.maps,
        topics.TOPOLOGY: Store.topology,
        topics.SUBMAP: Store.submap,
        topics.APPEARANCE: Store.appearances,
        topics.REMOVE: Store.remove,
        topics.NAME_PLACE: Store.name_place,
        topics.RESTRICT: Store.restrict,
        topics.ENDS: Store.ends,
        topics.REPORT: Store.report,
    }
    syncer = _syncer(service, keeper, settings)
    for topic, answer in answers.items():
        noticed = syncer.notice if syncer is not None and topic in _TO_SHARE else None
        service.bus.serve(topic, _handler(service, keeper, topic, answer, noticed))
    if syncer is None:
        refuse_sync(service)
    else:
        run_sync(service, syncer)
    service.ready()
    while not service.stop.wait(_CHECKPOINT_PERIOD_S):
        keeper.tidy()
    keeper.close()


def _syncer(service: Service, keeper: Keeper, settings: Settings) -> Syncer | None:
    if not settings.sync.endpoint:
        return None
    base = service.config.path.absolute().parent
    folder = service.config.directory / "sync"
    announce = Announce(service)
    return Syncer(keeper.store, settings.sync, service.config.robot.name, folder, base, announce, service.stop)


def _handler(
    service: Service,
    keeper: Keeper,
    topic: topics.Topic,
    answer: Callable[[Store, Any], Message],
    noticed: Callable[[], None] | None,
) -> Callable[[Any], Message]:
    stage = topic.key.rpartition("/")[2]

    def handle(question: Message) -> Message:
        with service.stage(stage):
            told = answer(keeper.store(), question)
        if noticed is not None:
            noticed()
        return told

    return handle
