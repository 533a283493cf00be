"""Between robots and operators and the fleet's server."""

from __future__ import annotations

from typing import Annotated, Self

import numpy as np
from pydantic import Field, model_validator

from common.arrays import AnyArray, Vector
from common.messages.base import Count, MapId, Message, Name, NotNegative, PlaceName, Stamp, Text, Weight
from common.messages.mission import Weights
from common.messages.sync import Bytes


class Announcement(Message):
    """Tells the server that a map, or a repeat's report, has just been committed to the storage."""

    environment: Name
    robot: Name
    map: MapId | None = None
    report: Name | None = None


class EnvironmentModel(Message):
    """The spectral model of an environment, (3.1) and (3.2) of the thesis, and what it was made of.

    ``revision`` grows with each change; ``maps`` is how many maps it was estimated from and ``reason`` says why there
    are no more rhythms, or none.
    """

    environment: Name
    stamp: Stamp
    revision: Count
    maps: Count
    periods_hours: list[Annotated[float, Field(gt=0)]] = []
    weights: list[float] = []
    phases: list[float] = []
    significance: list[NotNegative] = []
    trend_per_hour: NotNegative = 0.0
    reason: Text = ""

    @model_validator(mode="after")
    def _same_number(self) -> Self:
        if not len(self.periods_hours) == len(self.weights) == len(self.phases) == len(self.significance):
            raise ValueError("each period of a model has one weight, one phase and one significance")
        return self


class CatalogEntry(Message):
    """A shared map as plans see it: a directed edge between two places; ``stamp`` is when it was recorded.

    ``trouble`` (24,) is the share of the metres driven on it that were not localized, by hour of the day (UTC); empty
    where nobody has repeated it.
    """

    map: MapId
    start: PlaceName
    end: PlaceName
    stamp: Stamp
    length: NotNegative
    generation: Count
    sensor: Name
    bytes: Bytes = 0
    trouble: Annotated[list[Annotated[float, Field(ge=0, le=1)]], Field(max_length=24)] = []


class CatalogQuery(Message):
    """A page of an environment's shared maps in the order of their ids, those after ``after``."""

    environment: Name
    after: MapId | None = None
    limit: Annotated[int, Field(ge=1, le=10_000)] = 1000


class Catalog(Message):
    """Answer to ``fleet/<environment>/maps``."""

    entries: list[CatalogEntry]
    more: bool = False


class FleetPlanRequest(Message):
    """Asks for the maps of least cost between two places at the time ``stamp``, for robots with ``sensor``.

    ``without`` are maps that the robot cannot use.
    """

    environment: Name
    start: PlaceName
    goal: PlaceName
    stamp: Stamp
    sensor: Name
    theta: Weights
    per_metre: bool = False
    without: Annotated[list[MapId], Field(max_length=10_000)] = []


class FleetPlan(Message):
    """Answer to ``fleet/<environment>/plan``: the maps in order, a sentence on each and on the whole, and the model.

    ``alternatives`` are the shared maps beside these between the same places, a few of the cheapest, for a robot to
    plan by when it is alone.
    """

    entries: list[CatalogEntry]
    cost: Weight
    why: list[Text]
    model: EnvironmentModel
    alternatives: list[CatalogEntry] = []


class FleetEnvironments(Message):
    """Which environments the server knows, how many maps each has, and how many of them are still to be compared.

    Where the model is still to be made, one more is ``pending``.
    """

    maps: dict[Name, Count] = {}
    pending: dict[Name, Count] = {}


class FleetQuery(Message):
    """Asks for the fleet's environments."""


class SimilarityQuery(Message):
    """Asks for the similarity matrix of the newest ``limit`` maps between two places.

    Maps between other places are not compared with them. Where no places are given, those with most maps are meant.
    """

    environment: Name
    start: PlaceName | None = None
    end: PlaceName | None = None
    limit: Annotated[int, Field(ge=1, le=2000)] = 500


class SpectrumQuery(Message):
    """Asks for what the newest model's rhythms were found in."""

    environment: Name


class EnvironmentSpectrum(Message):
    """Answer to ``fleet/<environment>/spectrum``, of the model of the same ``revision``.

    ``power`` (M,) is the part of the variance of the maps' likeness that a wave of each of the ``frequencies`` (M,),
    1/hour, explains alone; ``levels`` are pairs of a probability and the power that chance reaches with it. All are
    empty where there were too few maps.
    """

    environment: Name
    revision: Count
    frequencies: Vector
    power: Vector
    levels: Annotated[list[tuple[NotNegative, NotNegative]], Field(max_length=16)] = []

    @model_validator(mode="after")
    def _same_number(self) -> Self:
        if self.frequencies.shape != self.power.shape or (self.frequencies <= 0.0).any():
            raise ValueError("a spectrum has one power for each of its frequencies, and these are positive")
        return self


class Similarities(Message):
    """Answer to ``fleet/<environment>/similarity``: (n, n) of n maps, float64, NaN nowhere, in their order."""

    maps: list[MapId]
    stamps: list[Stamp]
    values: AnyArray

    @model_validator(mode="after")
    def _square(self) -> Self:
        count = len(self.maps)
        if self.values.shape != (count, count) or self.values.dtype != np.float64 or len(self.stamps) != count:
            raise ValueError("a similarity matrix has a row, a column and a stamp for each map")
        return self
