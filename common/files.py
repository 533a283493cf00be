"""Files that only their owner may read."""

from __future__ import annotations

import os
from pathlib import Path

_OWNER_ONLY = 0o600
_READABLE_BY_OTHERS = 0o077


def write_private(path: Path, content: str) -> None:
    """Replaces a file in one step that nobody but its owner may read."""
    path.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
    draft = path.with_name(path.name + ".draft")
    draft.unlink(missing_ok=True)
    handle = os.open(draft, os.O_WRONLY | os.O_CREAT | os.O_EXCL, _OWNER_ONLY)
    with os.fdopen(handle, "w", encoding="utf-8") as out:
        out.write(content)
        out.flush()
        os.fsync(handle)
    draft.replace(path)


def open_to_others(path: Path) -> bool:
    """Whether others than its owner may do anything with a file.

    Raises:
        OSError: there is no such file.
    """
    return bool(path.stat().st_mode & _READABLE_BY_OTHERS)
