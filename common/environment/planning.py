"""The sequence of maps that costs least at a time, and why each of them was chosen."""

from __future__ import annotations

import difflib
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime

import numpy as np
from numpy.typing import NDArray

from common.environment.costs import Costs, Theta, map_costs
from common.environment.model import MapEntry, Model
from common.environment.network import Network
from common.environment.table import MapTable
from common.errors import GraphError

_LISTED = 8
"""Most names that a sentence lists."""
_SAME = 1e-9
"""Difference of two costs that is rounding."""
_FROM_NOW_HOURS = 48.0
"""Largest age that is told in hours; beyond, in days."""


@dataclass(frozen=True, slots=True)
class Plan:
    """Maps to drive over, one after another.

    Attributes:
        maps: their names.
        edges: their numbers in the table.
        cost: the sum of their edges' costs (:class:`Costs`).
        why: a sentence on each map, in the same order, then one on the whole.
        costs: what every map of the environment costs.
    """

    maps: list[str]
    edges: list[int]
    cost: float
    why: list[str]
    costs: Costs


def plan(
    maps: MapTable,
    network: Network,
    model: Model,
    start: str,
    goal: str,
    at_hours: float,
    theta: Theta,
    *,
    per_metre: bool = False,
    closed: NDArray[np.bool_] | None = None,
) -> Plan:
    """The path of least summed cost from one place to another at a time, hours since the Unix epoch.

    ``closed`` (N,) are maps that must not be driven on.

    Raises:
        GraphError: a place is unknown, the two are one, or no sequence of maps connects them.
    """
    first, last = _place(maps, start), _place(maps, goal)
    if first == last:
        raise GraphError(f"there is nothing to plan: start and goal are both '{start}'")
    costs = map_costs(maps, model, at_hours, theta, per_metre=per_metre)
    barred = np.zeros(len(maps), dtype=bool) if closed is None else closed
    edges = network.cheapest(np.where(barred, np.inf, costs.edge), first, last)
    if not edges:
        raise GraphError(f"no sequence of maps leads from '{start}' to '{goal}': {_reachable(maps, network, first)}")
    why = [_why_map(maps, network, costs, theta, at_hours, edge, barred) for edge in edges]
    shortest = network.cheapest(np.where(barred, np.inf, maps.length), first, last)
    why.append(_why_route(maps, costs, edges, shortest))
    return Plan([maps.names[edge] for edge in edges], edges, float(costs.edge[edges].sum()), why, costs)


def warm_up() -> None:
    """Compiles what a plan goes through, which takes seconds the first time on a machine."""
    hour = datetime.fromtimestamp(0.0, UTC)
    maps = MapTable.of([MapEntry(name="a", start="p", end="q", timestamp=hour, length=1.0)])
    plan(maps, Network.of(maps), Model(periods_hours=(24.0,), weights=(1.0,), phases=(0.0,)), "p", "q", 1.0, Theta())


def _place(maps: MapTable, name: str) -> int:
    if name in maps.places:
        return maps.places.index(name)
    near = difflib.get_close_matches(name, maps.places, 3)
    if near:
        raise GraphError(f"there is no place '{name}'; did you mean {' or '.join(near)}?")
    if not maps.places:
        raise GraphError(f"there is no place '{name}': the environment has no maps")
    raise GraphError(f"there is no place '{name}'; the places are {_listed(sorted(maps.places))}")


def _reachable(maps: MapTable, network: Network, start: int) -> str:
    within = network.reachable(start)
    within[start] = False
    places = sorted(maps.places[place] for place in np.flatnonzero(within).tolist())
    return f"from there maps lead to {_listed(places)}" if places else "no map leads anywhere from there"


def _listed(names: Sequence[str]) -> str:
    more = f" and {len(names) - _LISTED} more" if len(names) > _LISTED else ""
    return ", ".join(names[:_LISTED]) + more


def _why_map(
    maps: MapTable,
    network: Network,
    costs: Costs,
    theta: Theta,
    at_hours: float,
    edge: int,
    barred: NDArray[np.bool_],
) -> str:
    """What a chosen map costs and of what, and which maps between the same two places cost more."""
    ends = f"from {maps.places[int(maps.start[edge])]} to {maps.places[int(maps.end[edge])]}"
    recorded = datetime.fromtimestamp(float(maps.hours[edge]) * 3600.0, UTC)
    described = (
        f"{maps.names[edge]} {ends}, {maps.length[edge]:.1f} m, recorded {recorded:%Y-%m-%d %H:%M} UTC "
        f"({_age(at_hours - float(maps.hours[edge]))}), costs {costs.edge[edge]:.3f}: {_terms(costs, theta, edge)}"
    )
    parallel = network.parallel(edge)
    parallel = parallel[~barred[parallel]]
    others = parallel[parallel != edge]
    if len(others) == 0:
        return f"{described}; it is the only map {ends}"
    second = int(others[np.argmin(costs.edge[others])])
    return (
        f"{described}; it is the cheapest of the {len(parallel)} maps {ends}: "
        f"the next, {maps.names[second]}, costs {costs.edge[second]:.3f} ({_terms(costs, theta, second)})"
    )


def _age(hours: float) -> str:
    size = abs(hours)
    text = f"{size:.1f} h" if size <= _FROM_NOW_HOURS else f"{size / 24.0:.1f} days"
    return f"{text} {'before' if hours >= 0.0 else 'after'}"


def _terms(costs: Costs, theta: Theta, edge: int) -> str:
    """The terms of (3.6) that have a weight."""
    named = (("similarity", costs.similarity), ("distance", costs.distance), ("drift", costs.drift))
    terms = [
        f"{name} cost {values[edge]:.3f}" + (" sought" if weight < 0.0 else "")
        for weight, (name, values) in zip(theta.values, named, strict=True)
        if weight
    ]
    if theta.trouble and costs.trouble[edge] > _SAME:
        terms.append(f"trouble of repeats at this hour {costs.trouble[edge]:.3f}")
    return ", ".join(terms) or "every weight is zero"


def _why_route(maps: MapTable, costs: Costs, edges: Sequence[int], shortest: Sequence[int]) -> str:
    """What the whole costs, beside the shortest way."""
    total, length = float(costs.edge[edges].sum()), float(maps.length[edges].sum())
    count = f"{len(edges)} map{'s' if len(edges) > 1 else ''}"
    said = f"no sequence costs less than these {count}, {length:.1f} m, together {total:.3f}"
    other_length, other_cost = float(maps.length[shortest].sum()), float(costs.edge[shortest].sum())
    if length <= other_length + _SAME:
        return f"{said}; it is also the shortest"
    names = _listed([maps.names[edge] for edge in shortest])
    return f"{said}; the shortest ({names}), {other_length:.1f} m, costs {other_cost:.3f}"
