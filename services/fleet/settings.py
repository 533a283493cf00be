"""``[fleet]``: the server."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from pydantic import Field

from common.objects import StorageSettings


@dataclass(frozen=True, slots=True)
class Settings(StorageSettings):
    """The server's settings, and where the storage is; without an endpoint it is the embedded one of ``[storage]``.

    Attributes:
        reconcile_s: the storage is listed this often, for what nobody announced, seconds.
        compared: a new map is compared with so many of the newest of its route, and the model is made of so many.
        scheduler: address of a Dask scheduler that compares maps, as ``tcp://host:8786``; empty for this process's own
            threads.
        threads: of these, that compare maps.
        model_every_s: while maps keep coming, the model is made no more often than so, seconds; when no more come, at
            once.
        level: probability that a rhythm is claimed where there is none.
        shortest_hours: the shortest period that is sought.
        trouble_weight: what trouble of repeats weighs in a plan, beside theta.
        alternatives: maps beside a plan's that a robot is told of.
    """

    reconcile_s: Annotated[float, Field(gt=0, le=86400)] = 30.0
    compared: Annotated[int, Field(ge=2, le=10_000)] = 2000
    scheduler: str = ""
    threads: Annotated[int, Field(ge=1, le=256)] = 1
    model_every_s: Annotated[float, Field(ge=0, le=86400)] = 30.0
    level: Annotated[float, Field(ge=0.005, le=0.5)] = 0.01
    shortest_hours: Annotated[float, Field(gt=0, le=1e6)] = 3.0
    trouble_weight: Annotated[float, Field(ge=0, le=1000)] = 1.0
    alternatives: Annotated[int, Field(ge=0, le=100)] = 8
