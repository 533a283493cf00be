"""The shared maps of an environment: by their ids for robots that ask, and as growing columns for plans."""

from __future__ import annotations

from bisect import bisect_right, insort
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from common.environment import Costs, MapTable, Model, Network, Plan, Theta, plan
from common.environment.metadata import MapMetadata
from common.environment.trouble import HOURS
from common.errors import GraphError
from common.messages import CatalogEntry

Array = NDArray[np.float64]

_HOUR_NS = 3.6e12


@dataclass(frozen=True, slots=True)
class SharedMap:
    """What plans and robots need of a map.

    Attributes:
        map: its id.
        start, end: the places that it leads from and to, None for both where it leads nowhere a plan could use.
        stamp: when it was begun, nanoseconds.
        length: metres.
        generation: 0 for a taught one.
        sensor: what it was recorded by.
        bytes: of its archive.
        images: how many of them are compared with other maps'.
        trouble: the part of the metres driven on it that went wrong, by hour of the day; empty without reports.
    """

    map: str
    start: str | None
    end: str | None
    stamp: int
    length: float
    generation: int
    sensor: str
    bytes: int
    images: int = 0
    trouble: tuple[float, ...] = ()

    @classmethod
    def of(cls, metadata: MapMetadata, images: int) -> SharedMap:
        """The map that metadata describe."""
        leads = metadata.start is not None and metadata.end is not None
        return cls(
            map=metadata.name,
            start=metadata.start if leads else None,
            end=metadata.end if leads else None,
            stamp=round(metadata.timestamp.timestamp() * 1e6) * 1000,
            length=metadata.length,
            generation=metadata.generation,
            sensor=metadata.sensor,
            bytes=metadata.archive.bytes,
            images=images if leads else 0,
        )

    def entry(self) -> CatalogEntry:
        """The map as robots are told of it.

        Raises:
            ValueError: it leads nowhere.
        """
        if self.start is None or self.end is None:
            raise ValueError(f"map {self.map} leads nowhere")
        return CatalogEntry(
            map=self.map,
            start=self.start,
            end=self.end,
            stamp=self.stamp,
            length=self.length,
            generation=self.generation,
            sensor=self.sensor,
            bytes=self.bytes,
            trouble=list(self.trouble),
        )


class Columns:
    """Maps as the columns of a :class:`MapTable`, which grow in place; the graph is sorted again after a change."""

    def __init__(self, maps: Iterable[SharedMap] = ()) -> None:
        self.rows: dict[str, int] = {}
        self._names: list[str] = []
        self._places: list[str] = []
        self._numbers: dict[str, int] = {}
        self._size = 64
        kinds = {"start": np.int32, "end": np.int32, "hours": float, "length": float, "generation": np.int64}
        self._arrays: dict[str, NDArray[Any]] = {name: np.zeros(self._size, kind) for name, kind in kinds.items()}
        self._trouble: NDArray[np.float32] | None = None
        self._view: tuple[MapTable, Network] | None = None
        for one in maps:
            self.add(one)

    def __len__(self) -> int:
        return len(self._names)

    def add(self, one: SharedMap) -> None:
        """Adds a map that leads somewhere."""
        if len(self) == self._size:
            self._grow()
        row = len(self)
        ends = [self._number(place) for place in (one.start, one.end) if place is not None]
        values = (*ends, one.stamp / _HOUR_NS, one.length, one.generation)
        for array, value in zip(self._arrays.values(), values, strict=True):
            array[row] = value
        self.rows[one.map] = row
        self._names.append(one.map)
        self._view = None
        if one.trouble:
            self.set_trouble(one.map, one.trouble)

    def set_trouble(self, map_id: str, trouble: tuple[float, ...]) -> None:
        """Changes what repeats have told of a map; ``trouble`` is empty where they told of none."""
        if self._trouble is None:
            if not trouble:
                return
            self._trouble = np.zeros((self._size, HOURS), dtype=np.float32)
            self._view = None
        self._trouble[self.rows[map_id]] = trouble or 0.0

    def view(self) -> tuple[MapTable, Network]:
        """The columns and the graph of the maps that are there now."""
        if self._view is None:
            count = len(self)
            columns = {name: array[:count] for name, array in self._arrays.items()}
            trouble = None if self._trouble is None else self._trouble[:count]
            # A copy of the places: a search must not meet one that its graph does not have yet.
            table = MapTable(names=self._names, places=tuple(self._places), trouble=trouble, **columns)
            self._view = table, Network.of(table)
        return self._view

    def _number(self, place: str) -> int:
        number = self._numbers.setdefault(place, len(self._places))
        if number == len(self._places):
            self._places.append(place)
        return number

    def _grow(self) -> None:
        self._size *= 2
        self._arrays = {name: _twice(array) for name, array in self._arrays.items()}
        self._trouble = None if self._trouble is None else _twice(self._trouble)


def _twice(array: NDArray[Any]) -> NDArray[Any]:
    return np.concatenate([array, np.zeros_like(array)])


class Catalog:
    """All maps of an environment that are known, those that lead nowhere too; not safe for threads by itself."""

    def __init__(self, maps: Iterable[SharedMap] = ()) -> None:
        self._fill(maps)

    def _fill(self, maps: Iterable[SharedMap]) -> None:
        self._maps: dict[str, SharedMap] = {}
        self._leading: list[str] = []
        self._columns: dict[str, Columns] = {}
        for one in maps:
            self.add(one)

    def __len__(self) -> int:
        return len(self._leading)

    def __contains__(self, map_id: object) -> bool:
        return map_id in self._maps

    def __iter__(self) -> Iterator[SharedMap]:
        return iter(list(self._maps.values()))

    def __getitem__(self, map_id: str) -> SharedMap:
        return self._maps[map_id]

    def ids(self) -> set[str]:
        """The ids of all maps."""
        return set(self._maps)

    def add(self, one: SharedMap) -> None:
        """Adds a map; one that is known already is left as it is."""
        if one.map in self._maps:
            return
        self._maps[one.map] = one
        if one.start is not None:
            insort(self._leading, one.map)
            self._columns.setdefault(one.sensor, Columns()).add(one)

    def remove(self, ids: set[str]) -> None:
        """Takes out maps that are stored no longer."""
        self._fill([one for name, one in self._maps.items() if name not in ids])

    def set_trouble(self, map_id: str, trouble: tuple[float, ...]) -> None:
        """Changes what repeats have told of a map, if it is known."""
        one = self._maps.get(map_id)
        if one is not None:
            self._maps[map_id] = replace(one, trouble=trouble)
            if one.start is not None:
                self._columns[one.sensor].set_trouble(map_id, trouble)

    def page(self, after: str | None, limit: int) -> tuple[list[CatalogEntry], bool]:
        """Maps in the order of their ids, those after ``after``, and whether there are more."""
        first = 0 if after is None else bisect_right(self._leading, after)
        names = self._leading[first : first + limit]
        return [self._maps[name].entry() for name in names], first + limit < len(self._leading)

    def columns(self, sensor: str) -> Columns:
        """The maps of a sensor.

        Raises:
            GraphError: there are none.
        """
        if sensor not in self._columns:
            others = f"its maps are for {', '.join(sorted(self._columns))}" if self._columns else "it has no maps"
            raise GraphError(f"the environment has no shared map for a robot that localizes by {sensor}: {others}")
        return self._columns[sensor]


def unusable(columns: Columns, without: Iterable[str]) -> NDArray[np.bool_] | None:
    """(N,) which of the maps a robot cannot use; None where it can use all."""
    rows = [columns.rows[name] for name in without if name in columns.rows]
    if not rows:
        return None
    mask = np.zeros(len(columns), dtype=np.bool_)
    mask[rows] = True
    return mask


def planned(
    view: tuple[MapTable, Network],
    model: Model,
    ends: tuple[str, str],
    at_hours: float,
    theta: Theta,
    *,
    per_metre: bool,
    without: NDArray[np.bool_] | None,
    alternatives: int,
) -> tuple[Plan, list[str]]:
    """The plan, and beside each of its maps the names of the next few between the same places, cheapest first.

    Raises:
        GraphError: there is no such way.
    """
    table, network = view
    made = plan(table, network, model, *ends, at_hours, theta, per_metre=per_metre, closed=without)
    closed = np.zeros(len(table), dtype=np.bool_) if without is None else without
    chosen = set(made.edges)
    others = [edge for own in made.edges for edge in _next_best(network, made.costs, closed, own, alternatives)]
    return made, [table.names[edge] for edge in dict.fromkeys(others) if edge not in chosen]


def _next_best(network: Network, costs: Costs, closed: NDArray[np.bool_], edge: int, count: int) -> list[int]:
    parallel = network.parallel(edge)
    parallel = parallel[~closed[parallel] & (parallel != edge)]
    cheapest: list[int] = parallel[np.argsort(costs.edge[parallel], kind="stable")[:count]].tolist()
    return cheapest
