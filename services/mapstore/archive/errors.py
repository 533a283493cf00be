"""What can be wrong with an archive."""

from __future__ import annotations

from pathlib import Path

from common.errors import RetraverseError


class ArchiveError(RetraverseError):
    """A file that is no sound archive of a map; nothing of it was taken."""

    def __init__(self, file: Path, what: str) -> None:
        super().__init__(f"{file.name} is no sound map archive: {what}; fetch or export it again")
