"""What a session counts: samples sent by topic, and samples dropped by reason, logged at most once a second."""

from __future__ import annotations

import threading
import time
from collections import Counter

import structlog

_LOG_PERIOD_S = 1.0
_REASON_LENGTH = 200
_KEYS_KEPT = 256
_OTHER_KEYS = "other keys"

log = structlog.get_logger()


class Statistics:
    """Counters of a session; every method may be called from any thread."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._sent: Counter[str] = Counter()
        self._dropped: Counter[str] = Counter()
        self._last_log = 0.0
        self._silent = 0
        self._since = time.monotonic()

    def sent(self, key: str) -> None:
        """Counts a sample that was published."""
        with self._lock:
            self._sent[key] += 1

    def dropped(self, key: str, reason: str) -> None:
        """Counts a sample that was refused, and logs it unless another was logged within the last second."""
        now = time.monotonic()
        with self._lock:
            # Keys under a wildcard are whatever a stranger makes up: their number is bounded.
            known = key in self._dropped or len(self._dropped) < _KEYS_KEPT
            self._dropped[key if known else _OTHER_KEYS] += 1
            self._silent += 1
            if now - self._last_log < _LOG_PERIOD_S:
                return
            self._last_log, count, self._silent = now, self._silent, 0
        log.warning("samples dropped", key=key, reason=reason[:_REASON_LENGTH], count=count)

    def collect(self) -> tuple[dict[str, float], dict[str, int]]:
        """Rates (Hz) by key since the last call, and drops by key since the start."""
        now = time.monotonic()
        with self._lock:
            seconds = max(now - self._since, 1e-3)
            rates = {key: round(count / seconds, 2) for key, count in self._sent.items()}
            self._sent = Counter(dict.fromkeys(self._sent, 0))
            self._since = now
            return rates, dict(self._dropped)
