"""The thesis's maps as the fleet tells of them, and a stand-in for the server that tells it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from common import messages as m
from common import topics
from common.bus import Bus
from common.environment.model import parse_time
from common.errors import GraphError, Unavailable
from tests.common.environment.thesis import DAILY

SPECTRUM = (np.array([1 / 48, 1 / 24, 1 / 12]), np.array([0.1, 0.8, 0.05]))


def entries(rows, sensor="stereo", robot="r1") -> list[m.CatalogEntry]:
    """Rows of name, start, end, time, metres and, if any, n; a map's id ends with the number in its name."""
    return [_entry(sensor, robot, *row) for row in rows]


def names(told: Sequence[str]) -> list[str]:
    """The thesis's names of maps, of their ids."""
    return [f"map{int(one[-6:])}" for one in told]


def model(environment="campus", revision=1, **changed) -> m.EnvironmentModel:
    fields = {**DAILY, "significance": [0.001], "reason": "24 h found", "maps": 9, **changed}
    return m.EnvironmentModel(environment=environment, stamp=1, revision=revision, **fields)


class StandIn:
    """Answers as the fleet's server does, of whatever environments it is given."""

    def __init__(self, bus: Bus) -> None:
        self.environments: dict[str, list[m.CatalogEntry]] = {}
        self.models: dict[str, m.EnvironmentModel] = {}
        self.asked: list[str] = []
        self._publishers = {}
        self._bus = bus
        bus.serve(topics.ENVIRONMENTS, lambda _: self._names())
        bus.serve(topics.CATALOG, self._page, name="*")
        bus.serve(topics.SPECTRUM, self._spectrum, name="*")
        bus.serve(topics.SIMILARITY, self._similar, name="*")

    def learn(self, told: m.EnvironmentModel) -> None:
        self.models[told.environment] = told
        if told.environment not in self._publishers:
            self._publishers[told.environment] = self._bus.publisher(topics.MODEL, told.environment)
        self._publishers[told.environment].put(told)

    def _names(self) -> m.FleetEnvironments:
        self.asked.append("environments")
        return m.FleetEnvironments(maps={name: len(maps) for name, maps in self.environments.items()})

    def _page(self, query: m.CatalogQuery) -> m.Catalog:
        self.asked.append("catalog")
        later = [one for one in self.environments[query.environment] if query.after is None or one.map > query.after]
        return m.Catalog(entries=later[: query.limit], more=len(later) > query.limit)

    def _spectrum(self, query: m.SpectrumQuery) -> m.EnvironmentSpectrum:
        self.asked.append("spectrum")
        if query.environment not in self.models:
            raise Unavailable("no model has been made yet")
        frequencies, power = SPECTRUM
        revision = self.models[query.environment].revision
        return m.EnvironmentSpectrum(
            environment=query.environment, revision=revision, frequencies=frequencies, power=power, levels=[(0.01, 0.3)]
        )

    def _similar(self, query: m.SimilarityQuery) -> m.Similarities:
        maps = [
            one
            for one in self.environments[query.environment]
            if query.start in {None, one.start} and query.end in {None, one.end}
        ]
        if len(maps) < 2:
            raise GraphError("no maps have been compared there")
        values = np.full((len(maps), len(maps)), 0.25) + 0.75 * np.eye(len(maps))
        return m.Similarities(maps=[one.map for one in maps], stamps=[one.stamp for one in maps], values=values)


def _entry(sensor, robot, name, start, end, time, length, generation=0) -> m.CatalogEntry:
    moment = parse_time(time)
    return m.CatalogEntry(
        map=f"{moment:%Y%m%dT%H%M%S%f}-{robot}-{int(name.removeprefix('map')):06d}",
        start=start.lower(),
        end=end.lower(),
        stamp=round(moment.timestamp()) * 10**9,
        length=length,
        generation=generation,
        sensor=sensor,
    )
