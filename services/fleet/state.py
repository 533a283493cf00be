"""All that the server knows of one environment, and its answers from that; no input or output happens here."""

from __future__ import annotations

import threading
from bisect import bisect_left, insort
from collections.abc import Iterable, Sequence
from hashlib import sha256

import numpy as np
from numpy.typing import NDArray

from common import messages as m
from common.environment import Theta
from common.environment.told import model_told
from common.errors import GraphError, Unavailable
from services.fleet.catalog import Catalog, SharedMap, planned, unusable
from services.fleet.feedback import Feedback
from services.fleet.groups import Group, Key, Kind
from services.fleet.settings import Settings

Array = NDArray[np.float64]

_HOUR_NS = 3.6e12

Route = tuple[str, str]


class EnvironmentState:
    """An environment's maps, what repeats told of them, how alike they are, and the model; safe for threads.

    ``pending`` are the maps that have images and no row of similarities yet.
    """

    def __init__(self, name: str, settings: Settings) -> None:
        self.name = name
        self.lock = threading.RLock()
        self.catalog = Catalog()
        self.feedback = Feedback()
        self.groups: dict[Key, Group] = {}
        self.pending: set[str] = set()
        self.model = m.EnvironmentModel(environment=name, stamp=0, revision=0, maps=0, reason="no map is compared yet")
        self.spectrum: m.EnvironmentSpectrum | None = None
        self.made_of = ""
        self._settings = settings
        self._routes: dict[Route, list[str]] = {}

    def anew(self) -> EnvironmentState:
        """The same environment, of which nothing is known."""
        return EnvironmentState(self.name, self._settings)

    def fill(self, maps: Iterable[SharedMap], feedback: Feedback) -> None:
        """Begins anew with these maps, none of them compared."""
        with self.lock:
            self.catalog, self.feedback, self.made_of = Catalog(), feedback, ""
            self.groups, self.pending, self._routes = {}, set(), {}
            for one in maps:
                self.add(one)

    def add(self, one: SharedMap) -> None:
        """Adds a map, which plans may use from now on."""
        with self.lock:
            if one.map in self.catalog:
                return
            self.catalog.add(one)
            if trouble := self.feedback.trouble(one.map):
                self.catalog.set_trouble(one.map, trouble)
            if one.images and one.start is not None and one.end is not None:
                insort(self._routes.setdefault((one.start, one.end), []), one.map)
                self.pending.add(one.map)

    def remove(self, ids: set[str]) -> None:
        """Takes out maps that are stored no longer."""
        with self.lock:
            self.catalog.remove(ids)
            self.pending -= ids
            self._routes = {route: [name for name in names if name not in ids] for route, names in self._routes.items()}
            for group in self.groups.values():
                group.remove(ids)

    def report(self, key: str, report: m.RepeatReport) -> None:
        """Counts a repeat's report, once."""
        with self.lock:
            for map_id in self.feedback.add(key, report):
                self.catalog.set_trouble(map_id, self.feedback.trouble(map_id))

    def due(self) -> list[str]:
        """The pending maps, oldest first, without those that are too old to be compared."""
        with self.lock:
            self.pending = {name for name in self.pending if self._recent(self.catalog[name])}
            return sorted(self.pending)

    def group_of(self, map_id: str, kind: Kind) -> Group:
        """The maps that a map is compared with."""
        with self.lock:
            one = self.catalog[map_id]
            key = kind, str(one.start), str(one.end)
            return self.groups.setdefault(key, Group(key, self._settings.compared))

    def enter(self, map_id: str, kind: Kind, names: Sequence[str], values: Array) -> bool:
        """Adds a map's similarities to itself and to others, unless these are not all that there are."""
        with self.lock:
            if map_id not in self.catalog:
                return True
            hours = self.catalog[map_id].stamp / _HOUR_NS
            entered = self.group_of(map_id, kind).add(map_id, hours, names, values)
            if entered:
                self.pending.discard(map_id)
            return entered

    def dismiss(self, map_id: str) -> None:
        """Leaves a map without a row, for it has nothing to compare."""
        with self.lock:
            self.pending.discard(map_id)

    def compared(self) -> tuple[list[str], Array, Array, NDArray[np.int64]]:
        """Names, hours (n,), similarities (n, n) and groups (n,) of the maps to estimate the model from.

        Of groups with most maps first, as many as are compared in one of them at most; zero between two groups.
        """
        with self.lock:
            chosen, count = [], 0
            for group in sorted(self.groups.values(), key=len, reverse=True):
                if len(group) > 1 and count + len(group) <= self._settings.compared:
                    chosen.append(group.matrix())
                    count += len(group)
        matrix, groups, begin = np.zeros((count, count)), np.empty(count, dtype=np.int64), 0
        for number, (names, _, values) in enumerate(chosen):
            end = begin + len(names)
            matrix[begin:end, begin:end], groups[begin:end], begin = values, number, end
        hours = np.concatenate([hours for _, hours, _ in chosen]) if chosen else np.empty(0)
        return [name for names, _, _ in chosen for name in names], hours, matrix, groups

    def digest(self) -> str:
        """Stands for the maps that are compared now."""
        with self.lock:
            names = sorted(name for group in self.groups.values() if len(group) > 1 for name in group.ids)
        return sha256("\n".join(names).encode()).hexdigest()

    def grown(self) -> bool:
        """Whether at least as many maps are compared as the model was made of."""
        with self.lock:
            return sum(len(group) for group in self.groups.values() if len(group) > 1) >= self.model.maps

    def behind(self) -> int:
        """How many maps are still to be compared, and one more where the model is to be estimated."""
        with self.lock:
            return len(self.pending) + (self.made_of != self.digest())

    def page(self, query: m.CatalogQuery) -> m.Catalog:
        """A page of the maps."""
        with self.lock:
            entries, more = self.catalog.page(query.after, query.limit)
        return m.Catalog(entries=entries, more=more)

    def plan(self, request: m.FleetPlanRequest) -> m.FleetPlan:
        """The maps of least cost.

        Raises:
            GraphError: there is no such way.
        """
        with self.lock:
            columns = self.catalog.columns(request.sensor)
            view, without, model = columns.view(), unusable(columns, request.without), self.model
        made, others = planned(
            view,
            model_told(model),
            (request.start, request.goal),
            request.stamp / _HOUR_NS,
            Theta(*request.theta, trouble=self._settings.trouble_weight),
            per_metre=request.per_metre,
            without=without,
            alternatives=self._settings.alternatives,
        )
        with self.lock:
            entries, alternatives = (
                [self.catalog[name].entry() for name in names if name in self.catalog] for names in (made.maps, others)
            )
        why = [sentence[:2000] for sentence in made.why]
        return m.FleetPlan(entries=entries, cost=made.cost, why=why, model=model, alternatives=alternatives)

    def similarities(self, query: m.SimilarityQuery) -> m.Similarities:
        """The similarities of the newest maps between two places, or where most are.

        Raises:
            GraphError: none was compared there.
        """
        with self.lock:
            found = [
                group
                for (_, start, end), group in self.groups.items()
                if query.start in {None, start} and query.end in {None, end}
            ]
            group = max(found, key=len, default=None)
            if not group:
                waiting = f"; {len(self.pending)} are still to be compared" if self.pending else ""
                raise GraphError(f"no maps of environment '{self.name}' have been compared there{waiting}")
            names, _, values = group.matrix(query.limit)
            stamps = [self.catalog[name].stamp for name in names]
        return m.Similarities(maps=names, stamps=stamps, values=values)

    def spectrum_told(self) -> m.EnvironmentSpectrum:
        """What the model's rhythms were found in.

        Raises:
            Unavailable: no model has been made yet.
        """
        with self.lock:
            found = self.spectrum
        if found is None:
            raise Unavailable(f"no model of environment '{self.name}' has been made yet: ask again in a moment")
        return found

    def learn(self, model: m.EnvironmentModel, spectrum: m.EnvironmentSpectrum | None, made_of: str) -> None:
        """Takes a model, what its rhythms were found in, and the digest of the maps that it is made of."""
        with self.lock:
            self.model, self.spectrum, self.made_of = model, spectrum, made_of

    def _recent(self, one: SharedMap) -> bool:
        names = self._routes[str(one.start), str(one.end)]
        return len(names) - bisect_left(names, one.map) <= self._settings.compared
