"""Commits that are repeated until the map store has answered: nothing that was made is lost while the store is away."""

from __future__ import annotations

import queue
import threading
from collections.abc import Callable

import structlog

from common.errors import BusError, Refused
from common.messages import Commit, Done

log = structlog.get_logger()

_RETRY_S = 0.1
_IDLE_S = 0.2


class Committer:
    """Sends commits in order, each until it is answered, from a thread of its own.

    A store that is away, or whose disk is full, is asked again; a refusal means that it will never take the commit,
    which is dropped, and the reason kept in :attr:`refusal`.
    """

    def __init__(self, send: Callable[[Commit], Done], stop: threading.Event) -> None:
        self._send = send
        self._stop = stop
        self._waiting: queue.SimpleQueue[Commit] = queue.SimpleQueue()
        self._unanswered = 0
        self._lock = threading.Lock()
        self.refusal = ""

    def put(self, commit: Commit) -> None:
        """Queues a commit."""
        with self._lock:
            self._unanswered += 1
        self._waiting.put(commit)

    @property
    def unanswered(self) -> int:
        """Commits that the store has not answered yet."""
        return self._unanswered

    def run(self) -> None:
        """Works until the service stops."""
        while not self._stop.is_set():
            try:
                commit = self._waiting.get(timeout=_IDLE_S)
            except queue.Empty:
                continue
            self._deliver(commit)
            with self._lock:
                self._unanswered -= 1

    def _deliver(self, commit: Commit) -> None:
        reported = False
        while not self._stop.is_set():
            try:
                self._send(commit)
            except Refused as error:
                log.error("the map store refused a commit", reason=str(error))  # noqa: TRY400, its sentence says it all
                self.refusal = str(error)
                return
            except BusError as error:
                if not reported:
                    log.warning("a commit waits for the map store", reason=str(error))
                    reported = True
                self._stop.wait(_RETRY_S)
            else:
                return
