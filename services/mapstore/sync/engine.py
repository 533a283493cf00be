"""Decides what goes up and comes down next, and when to try again; knows no bus."""

from __future__ import annotations

import contextlib
import os
import threading
import time
from collections import OrderedDict
from collections.abc import Callable, Iterable
from pathlib import Path

import structlog

from common.environment.metadata import prefix
from common.errors import ConfigurationError, GraphError, MalformedMessage, RetraverseError, Unavailable
from common.messages import Announcement, FetchRequest, MapSummary, PushRequest, SyncState, SyncStatus, now_ns
from common.objects import ObjectStore, StorageError, StorageMissing
from common.objects.settings import read_credentials
from services.mapstore.store import Store
from services.mapstore.sync.backoff import Backoff
from services.mapstore.sync.fetching import NotFetched, fetch_map, make_room
from services.mapstore.sync.settings import SyncSettings
from services.mapstore.sync.sharing import MapConflict, forget, share_map, share_report
from services.mapstore.sync.transfers import Line, Transfers

IDLE_S = 5.0
_REPORTS = 20
_NICE = 10

log = structlog.get_logger()


class Syncer:
    """The store's two threads towards the fleet: :meth:`upload` and :meth:`fetch`, each until ``stop``."""

    def __init__(
        self,
        store: Callable[[], Store],
        settings: SyncSettings,
        robot: str,
        folder: Path,
        base: Path,
        announce: Callable[[Announcement], None],
        stop: threading.Event,
    ) -> None:
        """``store`` gives the open store; ``base`` is the configuration's folder; ``folder`` keeps what is sent."""
        self._store = store
        self._settings = settings
        self._robot = robot
        self._folder = folder
        self._base = base
        self._announce = announce
        self._stop = stop
        self._wanted: OrderedDict[str, str] = OrderedDict()
        self._in_use: frozenset[str] = frozenset()
        self._upload_wake, self._fetch_wake = threading.Event(), threading.Event()
        self._objects: ObjectStore | None = None
        self._lock, self._connecting = threading.Lock(), threading.Lock()
        self._rushed = threading.Event()
        self.transfers = Transfers(Line(online=False, reason="the storage was not asked yet"))

    # --- asked for ---------------------------------------------------------------------------------------------------

    def want(self, request: FetchRequest) -> str:
        """Takes maps to be fetched; says how many are not here yet."""
        here = {summary.record.id for summary in self._store().maps_of(request.environment)}
        missing = [map_id for map_id in request.maps if map_id not in here]
        with self._lock:
            self._in_use = self._in_use | frozenset(request.maps)
            for map_id in missing:
                if map_id not in self._wanted:
                    self._wanted[map_id] = request.environment
                    self.transfers.begin(request.environment, map_id, SyncState.WAITING, upload=False)
        self._store().touch(request.maps)
        self._fetch_wake.set()
        return f"{len(missing)} of {len(request.maps)} maps are to be fetched"

    def push(self, request: PushRequest) -> str:
        """Tries at once; takes maps out of quarantine, and those that are named need no ends."""
        store = self._store()
        freed = store.retry(self._robot, request.maps)
        store.seal_all(self._robot, request.maps, 0)
        self._rushed.set()
        self._upload_wake.set()
        count = len(store.to_share(self._robot))
        return f"{count} maps are to be shared" + (f", {freed} of them out of quarantine" if freed else "")

    def use(self, map_ids: Iterable[str]) -> None:
        """The maps that must not leave now."""
        with self._lock:
            self._in_use = frozenset(map_ids)

    def notice(self) -> None:
        """There may be something new to share."""
        self._upload_wake.set()

    def status(self) -> SyncStatus:
        """What is shared and fetched now; of a store that cannot be read, why."""
        now, quota = time.monotonic(), round(self._settings.quota_mb * 1e6)
        try:
            return self.transfers.status(now, self._store().counts(), quota)
        except Unavailable as error:
            return self.transfers.status(now, (0, 0, 0), quota).model_copy(update={"reason": str(error)})

    # --- threads -----------------------------------------------------------------------------------------------------

    def upload(self) -> None:
        """Shares maps and reports, oldest first."""
        self._run(self._upload_wake, self._share_next)

    def fetch(self) -> None:
        """Fetches what is wanted, in the order in which it was."""
        self._run(self._fetch_wake, self._fetch_next)

    def _run(self, wake: threading.Event, step: Callable[[], bool]) -> None:
        _be_nice()
        backoff = Backoff(self._settings.retry_s)
        while not self._stop.is_set():
            pause = IDLE_S
            try:
                if step():
                    pause = 0.0
                backoff.worked()
            except (StorageError, ConfigurationError, Unavailable, OSError) as error:
                pause = backoff.failed()
                self._report(self._sentence(error), pause)
            self._wait(wake, pause, patient=pause not in (0.0, IDLE_S))

    def _wait(self, wake: threading.Event, seconds: float, *, patient: bool) -> None:
        """Waits; after a failure not even new work ends the pause, but an operator's word or the end does."""
        end = time.monotonic() + seconds
        while (left := end - time.monotonic()) > 0 and not self._stop.is_set():
            woken = wake.wait(min(left, 0.2))
            if woken and (not patient or (wake is self._upload_wake and self._rushed.is_set())):
                break
        wake.clear()
        if wake is self._upload_wake:
            self._rushed.clear()

    def _share_next(self) -> bool:
        """Shares one map or some reports; returns whether there was any."""
        store = self._store()
        store.seal_all(self._robot, [], now_ns() - round(self._settings.seal_after_s * 1e9))
        waiting = store.to_share(self._robot)
        if waiting:
            self._share(store, waiting[0])
            return True
        reports = store.reports(_REPORTS)
        for report in reports:
            share_report(store, self._connection(), report)
            self._tell(Announcement(environment=report.environment, robot=self._robot, report=report.id))
        if not reports and self._objects is None:
            self._connection()
        return bool(reports)

    def _share(self, store: Store, summary: MapSummary) -> None:
        record = summary.record
        self.transfers.begin(record.environment, record.id, SyncState.UPLOADING, upload=True)
        try:
            share_map(store, self._connection(), summary, self._folder, self._advance(record.id, upload=True))
        except (MapConflict, GraphError, MalformedMessage, ValueError) as error:
            store.set_sync(record.id, SyncState.QUARANTINED, str(error))
            forget(self._folder, record.id)
            self.transfers.update(record.id, upload=True, state=SyncState.QUARANTINED, reason=str(error))
            log.error("a map cannot be shared", map=record.id, reason=str(error))  # noqa: TRY400, the sentence is enough
            return
        except (StorageError, Unavailable, OSError) as error:
            self.transfers.update(record.id, upload=True, state=SyncState.WAITING, reason=self._sentence(error))
            raise
        self.transfers.update(record.id, upload=True, state=SyncState.SYNCED, reason="")
        log.info("a map is shared", map=record.id)
        self._tell(Announcement(environment=record.environment, robot=self._robot, map=record.id))

    def _fetch_next(self) -> bool:
        with self._lock:
            if not self._wanted:
                return False
            map_id, environment = next(iter(self._wanted.items()))
        self.transfers.begin(environment, map_id, SyncState.UPLOADING, upload=False)
        try:
            fetch_map(
                self._store(),
                self._connection(),
                environment,
                map_id,
                self._folder,
                self._make_room,
                self._advance(map_id, upload=False),
            )
        except (NotFetched, StorageMissing, GraphError, MalformedMessage, ValueError) as error:
            self.transfers.update(map_id, upload=False, state=SyncState.QUARANTINED, reason=str(error))
            log.error("a map cannot be fetched", map=map_id, reason=str(error))  # noqa: TRY400, the sentence is enough
        except (StorageError, Unavailable, OSError) as error:
            self.transfers.update(map_id, upload=False, state=SyncState.WAITING, reason=self._sentence(error))
            raise
        else:
            self.transfers.update(map_id, upload=False, state=SyncState.FETCHED, reason="")
            log.info("a map is fetched", map=map_id)
        with self._lock:
            self._wanted.pop(map_id, None)
        return True

    # --- what both need ----------------------------------------------------------------------------------------------

    def _connection(self) -> ObjectStore:
        """The storage, once it was found to keep the condition that commits rely on."""
        with self._connecting:
            if self._objects is None:
                credentials = read_credentials(self._base / self._settings.credentials)
                objects = ObjectStore(self._settings, credentials)
                objects.check_conditional(prefix(self._robot))
                self._objects = objects
                if self.transfers.set_line(Line(online=True)):
                    log.info("the fleet's storage is reached", endpoint=self._settings.endpoint)
            return self._objects

    def _make_room(self, needed: int) -> None:
        make_room(self._store(), needed, round(self._settings.quota_mb * 1e6), self._in_use)

    def _advance(self, map_id: str, *, upload: bool) -> Callable[[int, int], None]:
        begun = time.monotonic()

        def advance(done: int, total: int) -> None:
            self.transfers.update(map_id, upload=upload, done=done, total=total)
            limit = self._settings.limit_mb_s * 1e6
            if upload and limit:
                self._stop.wait(max(begun + done / limit - time.monotonic(), 0.0))
            if self._stop.is_set():
                raise Unavailable("the map store is closing")

        return advance

    def _report(self, reason: str, pause: float) -> None:
        """Says a reason once, however often it is met."""
        self._objects = None
        if self.transfers.set_line(Line(online=False, reason=reason, retry_at=time.monotonic() + pause)):
            log.warning("the fleet's storage is not to be had", reason=reason)

    def _sentence(self, error: Exception) -> str:
        """An error for a person."""
        if isinstance(error, OSError):
            return f"cannot write to {self._folder}: {error.strerror or error}: free some space, or check its rights"
        return str(error)

    def _tell(self, announcement: Announcement) -> None:
        """Announces; the server finds by itself what it was not told."""
        with contextlib.suppress(RetraverseError):
            self._announce(announcement)


def _be_nice() -> None:
    """Lets every other thread of the robot go first; Linux gives each thread a niceness of its own."""
    with contextlib.suppress(OSError, AttributeError):
        os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), _NICE)
