"""What every message is, and the kinds of values that they are made of."""

from __future__ import annotations

import time
from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field, StringConstraints

from common.ids import MAP_ID_PATTERN, NAME_PATTERN, PLACE_PATTERN

SIDE = (16, 16384)
"""Least and most pixels of an image's side, and columns of a scan."""

Stamp = Annotated[int, Field(ge=0, lt=2**63)]
Name = Annotated[str, StringConstraints(pattern=NAME_PATTERN)]
PlaceName = Annotated[str, StringConstraints(pattern=PLACE_PATTERN)]
MapId = Annotated[str, StringConstraints(pattern=MAP_ID_PATTERN)]
Text = Annotated[str, StringConstraints(max_length=2000)]
Count = Annotated[int, Field(ge=0, lt=2**31)]
NotNegative = Annotated[float, Field(ge=0)]
Weight = Annotated[float, Field(ge=-1e6, le=1e6)]


def now_ns() -> int:
    """The stamp of this moment."""
    return time.time_ns()


class Message(BaseModel):
    """Base of every message: immutable, nothing unknown in it, every number finite."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False, arbitrary_types_allowed=True)
