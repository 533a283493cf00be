"""What each map costs at a time: (3.1), (3.2), (3.3) and (3.6) of the thesis, over columns of maps.

Times are hours, ``lag = t - s_k`` is the age of a map at the time of the drive, negative for a map recorded later.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from common.compiled import kernel
from common.environment.model import Model
from common.environment.table import MapTable
from common.environment.trouble import at_hour

Array = NDArray[np.float64]

DRIFT_GENERATIONS = 10.0
"""Generations after which a map recorded from a map from a map … has lost 1 - 1/e of its worth."""

_BLOCK = 2048
"""Maps whose lags stay in the processor's first cache while all periods pass over them."""

_S: Final = tuple((-1.0) ** k * (2.0 * math.pi) ** (2 * k + 1) / math.factorial(2 * k + 1) for k in range(12))
"""sin(2 pi u) in odd powers of u; over a quarter of a turn to either side the remainder is below 1e-17."""


@dataclass(frozen=True, slots=True)
class Theta:
    """The weights of (3.6): what a map's likeness to now, its length and its drift matter; negative to seek them.

    ``trouble`` is that of what repeats told of a map, which is never sought.
    """

    similarity: float = 1.0
    distance: float = 0.0
    drift: float = 0.0
    trouble: float = 1.0

    def __post_init__(self) -> None:
        if not all(map(math.isfinite, (*self.values, self.trouble))):
            raise ValueError("the weights theta must be finite numbers")
        if self.trouble < 0.0:
            raise ValueError("trouble cannot be sought: its weight is not negative")

    @property
    def values(self) -> tuple[float, float, float]:
        """theta_1, theta_2, theta_3."""
        return self.similarity, self.distance, self.drift


MODES: Final = {"robust": Theta(1.0, 0.0, 0.0), "shortest": Theta(0.0, 1.0, 0.0), "explore": Theta(-1.0, 0.0, 0.0)}
"""The thesis's three modes (its section 3.4.3)."""


@dataclass(frozen=True, slots=True)
class Costs:
    """The costs of N maps at one time.

    Attributes:
        similarity: (N,) C_k of (3.3).
        distance: (N,) d_k, the length divided by the longest map's.
        drift: (N,) delta(n_k).
        trouble: (N,) the share of metres not localized at this hour of the day.
        cost: (N,) J_k of (3.6), and the trouble.
        edge: (N,) what a plan adds up, never negative: J_k, but for terms whose theta is negative.
    """

    similarity: Array
    distance: Array
    drift: Array
    trouble: Array
    cost: Array
    edge: Array


def map_costs(maps: MapTable, model: Model, at_hours: float, theta: Theta, *, per_metre: bool = False) -> Costs:
    """The costs of all maps at a time, hours since the Unix epoch.

    A sum over maps favours few long maps. With ``per_metre``, likeness and drift count for each metre that is driven on
    a map: their terms are multiplied by d_k. The distance is one for each metre already.

    A negative theta seeks what its term avoids. So that no edge is negative and no route gains by going in circles, the
    term of an edge is then ``|theta| (upper bound - term)``; and should the model's weights let C_k fall below zero,
    its lower bound is taken off likewise.

    Where repeats have told of maps (:mod:`common.environment.trouble`), ``theta.trouble`` times their trouble at this
    hour of the day is added, for the whole map or for each of its metres as the likeness is.
    """
    similarity = similarity_cost(model, at_hours - maps.hours)
    distance, drift = distance_cost(maps.length), drift_cost(maps.generation)
    share = distance if per_metre else 1.0
    terms = ((similarity, *similarity_bounds(model), share), (distance, 0.0, 1.0, 1.0), (drift, 0.0, 1.0, share))
    cost, edge = np.zeros(len(maps)), np.zeros(len(maps))
    for weight, (term, lower, upper, scale) in zip(theta.values, terms, strict=True):
        if weight:
            cost += weight * term * scale
            above = term - min(lower, 0.0) if weight > 0.0 else upper - term
            edge += abs(weight) * np.maximum(above, 0.0) * scale
    trouble = np.zeros(len(maps)) if maps.trouble is None else at_hour(maps.trouble, at_hours)
    if maps.trouble is not None and theta.trouble:
        raised = theta.trouble * trouble * share
        cost, edge = cost + raised, edge + raised
    return Costs(similarity, distance, drift, trouble, cost, edge)


def similarity_cost(model: Model, lag: Array) -> Array:
    """C_k of (3.3) for lags (N,): the sum of the cyclic and the trend cost."""
    return cyclic_cost(model, lag) + trend_cost(model.trend_per_hour, lag)


def cyclic_cost(model: Model, lag: Array) -> Array:
    """(3.1): ``1/2 - 1/(2N) sum_i w_i cos(2 pi lag / T_i - phi_i)``; 1/2 where the model knows no period."""
    count = max(1, len(model.periods_hours))
    turns_per_hour = 1.0 / np.array(model.periods_hours)
    offsets = np.array(model.phases) / (2.0 * math.pi)
    factors = np.array(model.weights) / (-2.0 * count)
    return _waves(np.ascontiguousarray(lag, dtype=np.float64), turns_per_hour, offsets, factors)


def trend_cost(rate: float, lag: Array) -> Array:
    """(3.2): ``1 - exp(-a lag)``, 0 for maps of the future; ``rate`` is a, 1/hour."""
    if rate == 0.0:
        return np.zeros_like(lag)
    cost: Array = 0.0 - np.expm1(-rate * np.maximum(lag, 0.0))
    return cost


def similarity_bounds(model: Model) -> tuple[float, float]:
    """The least and the largest value that C_k can take under a model."""
    swing = sum(map(abs, model.weights)) / (2.0 * max(1, len(model.weights)))
    return 0.5 - swing, 0.5 + swing + (1.0 if model.trend_per_hour else 0.0)


def distance_cost(length: Array) -> Array:
    """d_k: lengths (N,), metres, divided by the longest map's."""
    longest = float(length.max(initial=0.0))
    share: Array = length / longest if longest > 0.0 else np.zeros_like(length)
    return share


def drift_cost(generation: NDArray[np.int64]) -> Array:
    """delta(n_k) of (3.6), which the thesis leaves open: ``1 - exp(-n_k / 10)``, of the form of (3.2).

    A taught map has none; each recording from a recording adds an offset of its own, the first of them matter most,
    and the 50th map (the thesis's example) has lost nearly everything.
    """
    drift: Array = 0.0 - np.expm1(-generation / DRIFT_GENERATIONS)
    return drift


@kernel
def _waves(lag: Array, turns_per_hour: Array, offsets: Array, factors: Array) -> Array:
    """``1/2 + sum_i factor_i cos(2 pi (lag turns_i - offset_i))`` for each lag (N,).

    The cosine is a polynomial without branches, which the compiler turns into vector instructions.
    """
    out = np.full(len(lag), 0.5)
    for begin in range(0, len(lag), _BLOCK):
        lags, sums = lag[begin : begin + _BLOCK], out[begin : begin + _BLOCK]
        for i in range(len(factors)):
            per_hour, offset, factor = turns_per_hour[i], offsets[i], factors[i]
            for k in range(len(sums)):
                turns = lags[k] * per_hour - offset
                u = 0.25 - abs(turns - np.floor(turns + 0.5))  # cos(2 pi turns) = sin(2 pi u)
                q = u * u
                high = ((((_S[11] * q + _S[10]) * q + _S[9]) * q + _S[8]) * q + _S[7]) * q + _S[6]
                low = ((((high * q + _S[5]) * q + _S[4]) * q + _S[3]) * q + _S[2]) * q + _S[1]
                sums[k] += factor * u * (low * q + _S[0])
    return out
