"""``[mapstore.sync]``: where the fleet's storage is, and how much of it a robot keeps."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from pydantic import Field

from common.objects import StorageSettings


@dataclass(frozen=True, slots=True)
class SyncSettings(StorageSettings):
    """The storage, and how it is used; without an endpoint nothing is shared.

    Attributes:
        quota_mb: megabytes of maps that are kept; maps that the storage has leave for others, the one that was used
            longest ago first. 0: as many as the disk holds.
        limit_mb_s: megabytes a second that uploads take at most. 0: as many as there are.
        retry_s: longest pause before another try, seconds.
        seal_after_s: a finished map whose ends nobody told is shared without names after this, seconds.
    """

    quota_mb: Annotated[float, Field(ge=0)] = 0.0
    limit_mb_s: Annotated[float, Field(ge=0)] = 0.0
    retry_s: Annotated[float, Field(gt=0, le=3600)] = 60.0
    seal_after_s: Annotated[float, Field(ge=0)] = 3600.0
