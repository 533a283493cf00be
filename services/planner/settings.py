"""``[planner]``: how long the planner waits for the map store."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from pydantic import Field


@dataclass(frozen=True, slots=True)
class Settings:
    """The planner's settings.

    Attributes:
        store_timeout_s: how long a plan waits for the map store before it is made of the graph that the store gave
            last, seconds; below the 2 s after which the asker of a plan gives up.
    """

    store_timeout_s: Annotated[float, Field(gt=0, le=60)] = 1.0
