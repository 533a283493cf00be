"""``[mapstore]``: how the store waits, tidies up and leaves room."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated

from pydantic import Field

from services.mapstore.sync.settings import SyncSettings


@dataclass(frozen=True, slots=True)
class Settings:
    """The map store's settings.

    Attributes:
        lock_timeout_s: how long a commit or query waits for another process that holds the store's lock, seconds;
            below the 2 s after which the asker gives up.
        checkpoint_mb: committed megabytes in the write-ahead log after which they are moved to the store's main file,
            beside the commits. More makes fewer and longer moves, and a larger log.
        sync: the fleet's storage, see :class:`services.mapstore.sync.settings.SyncSettings`.
        reserve_mb: free megabytes of the disk that new vertices leave. On a disk without any, no map could be finished,
            and none removed, since a removal is written to the log first.
    """

    lock_timeout_s: Annotated[float, Field(ge=0, le=60)] = 1.0
    checkpoint_mb: Annotated[float, Field(gt=0)] = 4.0
    reserve_mb: Annotated[float, Field(ge=0)] = 64.0
    sync: SyncSettings = field(default_factory=SyncSettings)
