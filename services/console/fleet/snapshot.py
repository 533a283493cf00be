"""What is known of the fleet at a moment; immutable, so that every page may read it while the next one is made."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Self

import numpy as np

from common import messages as m
from common.environment import MapTable, Model, Network
from common.environment.layout import places_in_plane
from common.environment.told import map_told, model_told

Route = tuple[str, str]
"""The places that maps lead from and to."""

PLACES = 150
"""Most places of a drawing."""


@dataclass(frozen=True, eq=False)
class Known:
    """One environment: its maps, its model, and what that was found in.

    Attributes:
        name: its own.
        version: grows with each change.
        entries: the shared maps, by their ids.
        told: the model as it was published last; None before the first.
        spectrum: what its rhythms were found in; None where the server does not say.
        pending: how many maps, and models, the server has still to compare and to make.
    """

    name: str
    version: int = 0
    entries: tuple[m.CatalogEntry, ...] = ()
    told: m.EnvironmentModel | None = None
    spectrum: m.EnvironmentSpectrum | None = None
    pending: int = 0

    @cached_property
    def model(self) -> Model:
        """The parameters of (3.1) and (3.2)."""
        return model_told(self.told)

    @cached_property
    def sensors(self) -> tuple[str, ...]:
        """What its maps were recorded by."""
        return tuple(sorted({entry.sensor for entry in self.entries}))

    @cached_property
    def _maps(self) -> dict[str, Maps]:
        return {}

    def maps(self, sensor: str = "") -> Maps:
        """Its maps for plans: those of a sensor, for a robot can use no others; all of them where none is named."""
        if sensor not in self._maps:
            self._maps[sensor] = Maps.of(entry for entry in self.entries if sensor in {"", entry.sensor})
        return self._maps[sensor]


@dataclass(frozen=True, eq=False)
class Maps:
    """Maps as columns, and as the graph that they are the edges of."""

    table: MapTable
    network: Network

    @classmethod
    def of(cls, entries: Iterable[m.CatalogEntry]) -> Self:
        """Maps as they were told."""
        table = MapTable.of(map(map_told, entries))
        return cls(table, Network.of(table))

    @cached_property
    def routes(self) -> dict[Route, int]:
        """How many maps lead from one place to another, most first."""
        ends = zip(self.table.start.tolist(), self.table.end.tolist(), strict=True)
        counted = Counter(ends).most_common()
        return {(self.table.places[start], self.table.places[end]): count for (start, end), count in counted}

    @cached_property
    def points(self) -> dict[str, tuple[float, float]]:
        """Where the places with most maps are drawn, metres (:mod:`common.environment.layout`)."""
        table = self.table
        count = np.bincount(np.concatenate([table.start, table.end]), minlength=len(table.places))
        used = np.argsort(-count, kind="stable")[:PLACES].astype(np.int64)
        within = np.zeros(len(table.places), dtype=np.bool_)
        within[used] = True
        joining = np.flatnonzero(within[table.start] & within[table.end])
        drawn = places_in_plane(table, used, joining)
        return {table.places[k]: (float(x), float(y)) for k, (x, y) in zip(used.tolist(), drawn, strict=True)}


@dataclass(frozen=True, slots=True, eq=False)
class Snapshot:
    """The fleet as it was told last.

    Attributes:
        missing: why the fleet's server cannot be asked, in a sentence; empty while it answers.
        maps, pending: by environment, how many maps it has and how many are still to be compared.
        environments: those that a page looks at.
        present: the processes of each robot that is connected.
        states: what each of them is doing.
    """

    missing: str = "the fleet's server has not been asked yet"
    maps: Mapping[str, int] = field(default_factory=dict)
    pending: Mapping[str, int] = field(default_factory=dict)
    environments: Mapping[str, Known] = field(default_factory=dict)
    present: Mapping[str, frozenset[str]] = field(default_factory=dict)
    states: Mapping[str, m.State] = field(default_factory=dict)
