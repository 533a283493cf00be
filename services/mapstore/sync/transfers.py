"""What is on its way, for whoever watches: one table that the threads of the engine write and that is published."""

from __future__ import annotations

import threading
from dataclasses import dataclass, replace

from common.messages import SyncState, SyncStatus, Transfer, now_ns

_KEPT = 32
"""Transfers that have ended and are still shown."""


@dataclass(frozen=True, slots=True)
class Line:
    """How the storage is reached: whether it is, why not, and when it is tried again (monotonic, s)."""

    online: bool
    reason: str = ""
    retry_at: float = 0.0


class Transfers:
    """The table. Any thread may write; ``changed`` is set by whatever somebody should see."""

    def __init__(self, line: Line) -> None:
        self.changed = threading.Event()
        self._lock = threading.Lock()
        self._rows: dict[tuple[str, bool], Transfer] = {}
        self._line = line

    def begin(self, environment: str, map_id: str, state: SyncState, *, upload: bool) -> None:
        """A map is on its way, or waits for it; its attempts are counted."""
        with self._lock:
            old = self._rows.pop((map_id, upload), None)
            attempts = 0 if old is None else old.attempts
            self._rows[map_id, upload] = Transfer(
                map=map_id,
                environment=environment,
                state=state,
                upload=upload,
                attempts=attempts + (state is SyncState.UPLOADING),
            )
            for key in list(self._rows)[:-_KEPT]:
                del self._rows[key]
        self.changed.set()

    def update(self, map_id: str, *, upload: bool, **fields: object) -> None:
        """Something of a transfer has changed."""
        with self._lock:
            row = self._rows.get((map_id, upload))
            if row is not None:
                self._rows[map_id, upload] = row.model_copy(update=fields)
        self.changed.set()

    def state_of(self, map_id: str, *, upload: bool) -> SyncState | None:
        """The state of a transfer, None where there is none."""
        with self._lock:
            row = self._rows.get((map_id, upload))
            return None if row is None else row.state

    def set_line(self, line: Line) -> bool:
        """How the storage is reached now; returns whether that is news."""
        with self._lock:
            news = (line.online, line.reason) != (self._line.online, self._line.reason)
            self._line = line
        self.changed.set()
        return news

    def busy(self) -> bool:
        """Whether anything moves."""
        with self._lock:
            return any(row.state is SyncState.UPLOADING for row in self._rows.values())

    def status(self, now: float, counts: tuple[int, int, int], quota: int) -> SyncStatus:
        """The table as it is published."""
        waiting, synced, stored = counts
        with self._lock:
            line, rows = replace(self._line), list(self._rows.values())
        return SyncStatus(
            stamp=now_ns(),
            online=line.online,
            reason=line.reason[:2000],
            retry_s=max(line.retry_at - now, 0.0),
            transfers=rows,
            waiting=waiting,
            synced=synced,
            stored=stored,
            quota=quota,
        )
