"""What every map costs over a day, and which of these curves are drawn."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from common.environment import Costs, MapTable, Model, Theta, map_costs

Array = NDArray[np.float64]

HOURS: Array = np.linspace(0.0, 24.0, 97)
"""The times of day of the curves: every quarter of an hour, both midnights among them."""

_HOURS_A_DAY = 24.0


def midnight(at_hours: float) -> float:
    """When the day of a time began, hours since the Unix epoch, UTC."""
    return math.floor(at_hours / _HOURS_A_DAY) * _HOURS_A_DAY


def over_day(
    maps: MapTable, model: Model, begin: float, theta: Theta, shown: Sequence[int], *, per_metre: bool = False
) -> Array:
    """(T, K) the cost J of the K ``shown`` of all maps, at each of :data:`HOURS` of the day that begins then."""
    rows = np.array(shown, dtype=np.int64)
    return np.array(
        [map_costs(maps, model, begin + hour, theta, per_metre=per_metre).cost[rows] for hour in HOURS.tolist()]
    )


def drawn(costs: Costs, chosen: Sequence[int], most: int) -> list[int]:
    """The numbers of the maps to draw: the chosen ones, then the cheapest, ``most`` in all."""
    first = list(dict.fromkeys(chosen))
    within = set(first)
    others = [k for k in np.argsort(costs.cost, kind="stable")[: most + len(first)].tolist() if k not in within]
    return [*first, *others][: max(most, len(first))]
