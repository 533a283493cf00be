"""``[planner]``: how maps are chosen, and how long others are waited for."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from pydantic import Field

from common.messages import Mode

Weight = Annotated[float, Field(ge=-1e6, le=1e6)]


@dataclass(frozen=True, slots=True)
class Settings:
    """The planner's settings.

    Attributes:
        store_timeout_s: how long a plan waits for the map store before it is made of the graph that the store gave
            last, seconds; below the 2 s after which the asker of a plan gives up.
        fleet_timeout_s: and for the fleet's server, before it is made of what is known here, seconds.
        mode: how maps are chosen where a command does not say: robust, shortest or explore.
        theta: the weights of likeness, distance and drift instead of a mode.
        trouble_weight: what trouble of repeats weighs beside theta.
        per_metre: whether likeness and drift count for each metre, so that few long maps gain nothing.
    """

    store_timeout_s: Annotated[float, Field(gt=0, le=60)] = 1.0
    fleet_timeout_s: Annotated[float, Field(gt=0, le=60)] = 0.8
    mode: Mode = "robust"
    theta: tuple[Weight, Weight, Weight] | None = None
    trouble_weight: Annotated[float, Field(ge=0, le=1000)] = 1.0
    per_metre: bool = False
