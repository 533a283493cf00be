"""Which maps lead from one place to another for least cost now: the thesis's plan, over what a robot knows itself."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from common.environment import MapTable, Model, Network, Theta
from common.environment import plan as best_plan
from common.environment.told import map_told
from common.errors import GraphError
from common.ids import VertexId
from common.messages import CatalogEntry
from common.posegraph import PoseGraph

_NEAR_M = 2.0
"""A robot no farther than this from a map's end stands at the place where it ends."""


@dataclass(frozen=True, slots=True)
class Chosen:
    """Maps to drive over, in order, and a sentence on each and on the whole."""

    maps: list[str]
    why: list[str]


@dataclass(frozen=True, slots=True)
class Whence:
    """Where a plan between places begins, for a robot at a vertex.

    Attributes:
        place: the place.
        before: the map that is driven to its end to get there; None where the robot is there.
    """

    place: str
    before: str | None = None


def entries_of(graph: PoseGraph) -> list[CatalogEntry]:
    """A robot's own maps that lead from a place to a place, as a plan sees them."""
    return [
        CatalogEntry(
            map=map_id,
            start=experience.start_place,
            end=experience.end_place,
            stamp=experience.record.stamp,
            length=experience.length,
            generation=experience.record.generation,
            sensor=experience.record.sensor,
        )
        for map_id, experience in graph.experiences.items()
        if experience.finished and experience.start_place is not None and experience.end_place is not None
    ]


def whence(graph: PoseGraph, start: VertexId) -> Whence | None:
    """The place that a robot at a vertex stands at, or gets to by driving its map to the end; None if it has none."""
    named = next((name for name, vertex in graph.places.items() if vertex == start), None)
    starts = {e.start_place for e in graph.experiences.values() if e.start_place is not None}
    if named in starts:
        return Whence(str(named))
    experience = graph.experience(start.map_id)
    if start.index == 0 and experience.start_place is not None:
        return Whence(experience.start_place)
    if experience.end_place is None:
        return None
    rest = graph.vertices(start.map_id)[start.index :]
    return Whence(experience.end_place, None if graph.length_along(rest) <= _NEAR_M else start.map_id)


def choose(
    entries: Iterable[CatalogEntry], model: Model, start: str, goal: str, at_hours: float, theta: Theta, sensor: str
) -> Chosen:
    """The maps of least cost, of those that a sensor made.

    Raises:
        GraphError: a place is unknown, or no sequence of such maps leads from one to the other.
    """
    usable = [entry for entry in entries if entry.sensor == sensor]
    if not usable:
        raise GraphError("no map leads from a place to a place")
    table = MapTable.of(map(map_told, usable))
    found = best_plan(table, Network.of(table), model, start, goal, at_hours, theta)
    return Chosen(found.maps, found.why)


def merged(own: Sequence[CatalogEntry], told: Iterable[CatalogEntry]) -> list[CatalogEntry]:
    """A robot's own maps and those that it was told of, each once; what the fleet says of a map is the newer word."""
    by_name = {entry.map: entry for entry in own}
    by_name.update({entry.map: entry for entry in told})
    return list(by_name.values())


def hours(stamp_ns: int) -> float:
    """Hours since the Unix epoch."""
    return float(np.float64(stamp_ns) / 3.6e12)
