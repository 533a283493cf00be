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
        fetch_s: a plan whose maps are being fetched is given up when nothing of them came for so long.
        go_on_m: so many metres before the end of a route that is not the end of its plan, it is asked for more.
        localize_s: a robot that is not localized within this time ends in Idle.
        merge_s: a merge without a loop closure is given up after this time, and the map is taught on.
        confirm_s: so is a loop closure that the operator has neither confirmed nor rejected.
        pause_ahead_m: a pause at a vertex is at one that lies this far ahead at least, so that the robot stops softly.
        paused_s: a pause longer than this ends in Idle; infinite by default, as a pause waits for a person.
        recover_s: a pause for something that was lost ends by itself when that is back within this time, and in Idle
            when it is not; 0: it always waits for the operator. After an emergency stop it always does.
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
    fetch_s: Seconds = 60.0
    go_on_m: Annotated[float, Field(gt=0)] = 20.0
    localize_s: Seconds = 30.0
    merge_s: Seconds = 60.0
    confirm_s: Seconds = 120.0
    pause_ahead_m: Annotated[float, Field(ge=0, le=100)] = 2.0
    paused_s: Seconds = float("inf")
    recover_s: Annotated[float, Field(ge=0)] = 60.0
    first_data_s: Seconds = 30.0
    data_s: Seconds = 5.0
    localization_s: Seconds = 10.0
    relocalize_s: Seconds = 4.0
    record_repeats: bool = True
    finish_s: Seconds = 8.0
    store_s: Seconds = 2.0
