"""``[obstacles]``: by which sensor things are looked for, where, and how often."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated

from pydantic import Field

from services.obstacles.zones import ZoneSettings


@dataclass(frozen=True, slots=True)
class Settings:
    """What the robot looks for obstacles with.

    Attributes:
        lidar: name of the lidar's topic; None to look by stereo.
        camera: name of the stereo camera's topic.
        period_s: seconds between two looks, at least.
        width: pixels that stereo images are shrunk to.
        nearest: stereo sees nothing that is nearer, metres.
        sees: a frame of which less than this part was measured is blind, and not told of.
        zones: where something is in the way, and when that counts.
    """

    lidar: str | None = None
    camera: str = "front"
    period_s: Annotated[float, Field(gt=0, le=0.3)] = 0.1
    width: Annotated[int, Field(ge=80, le=2000)] = 240
    nearest: Annotated[float, Field(gt=0, le=10)] = 0.5
    sees: Annotated[float, Field(ge=0, le=1)] = 0.05
    zones: ZoneSettings = field(default_factory=ZoneSettings)
