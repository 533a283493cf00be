"""``[tracker]``: the path follower, the replay of actions, what is known of the base, and the loop."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated

from pydantic import Field

from services.tracker.follower import FollowerSettings
from services.tracker.predict import BaseModel
from services.tracker.replay import ReplaySettings


@dataclass(frozen=True, slots=True)
class Settings:
    """How the robot follows a route.

    Attributes:
        follower: limits, path, model-predictive control, caution and the end of the route.
        replay: how taught actions are replayed, on routes that are known by bearing alone.
        base: delay and lag of the base, by which the present state is predicted.
        period_s: a command is due this long (s) after the last one, and at once after a localization.
        longest_m: a route longer than this (m) is taken for an error and not followed.
    """

    follower: FollowerSettings = field(default_factory=FollowerSettings)
    replay: ReplaySettings = field(default_factory=ReplaySettings)
    base: BaseModel = field(default_factory=BaseModel)
    period_s: Annotated[float, Field(gt=0, le=0.2)] = 0.05
    longest_m: Annotated[float, Field(gt=0, le=100_000)] = 20_000.0
