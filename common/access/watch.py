"""Files that a process has read at its start, and for which it is started anew."""

from __future__ import annotations

import time
from collections.abc import Sequence
from pathlib import Path

_PERIOD_S = 1.0


class Watch:
    """Tells which of some files were replaced or changed, looking once a second."""

    def __init__(self, files: Sequence[Path]) -> None:
        self._states = {path: _state(path) for path in files}
        self._looked = time.monotonic()

    def changed(self) -> list[Path]:
        """Those that have changed since the last look."""
        now = time.monotonic()
        if now - self._looked < _PERIOD_S:
            return []
        self._looked = now
        before, self._states = self._states, {path: _state(path) for path in self._states}
        return [path for path, state in self._states.items() if state != before[path]]


def _state(path: Path) -> tuple[int, int, int]:
    try:
        status = path.stat()
    except OSError:
        return 0, 0, 0
    return status.st_mtime_ns, status.st_size, status.st_ino
