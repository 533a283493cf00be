"""``[navigator]``: how long the navigator waits, and what it records."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from pydantic import Field

Seconds = Annotated[float, Field(gt=0)]


@dataclass(frozen=True, slots=True)
class Settings:
    """All times in seconds.

    Attributes:
        plan_s: deadline of the planner's answer; a repeat without one ends in Idle.
        localize_s: a robot that is not localized within this time ends in Idle.
        paused_s: a pause longer than this ends in Idle; infinite by default, as a pause waits for a person.
        first_data_s: how long after the start of driving the data that it needs may take to begin.
        data_s: a gap in these data that is longer pauses the mission. Safety, whose limits are shorter, has stopped the
            robot by then; a gap that ends sooner costs a short stop and no operator's help.
        localization_s: a robot that drives on dead reckoning for longer is paused.
        relocalize_s: deadline of the estimator's answer where the robot is to find itself.
        record_repeats: whether a repeat records an experience on its way, unless its command says otherwise.
        finish_s: deadline for a taught map to be complete in the store.
        store_s: deadline of the store's other answers.
    """

    plan_s: Seconds = 2.0
    localize_s: Seconds = 30.0
    paused_s: Seconds = float("inf")
    first_data_s: Seconds = 30.0
    data_s: Seconds = 5.0
    localization_s: Seconds = 10.0
    relocalize_s: Seconds = 4.0
    record_repeats: bool = True
    finish_s: Seconds = 8.0
    store_s: Seconds = 2.0
