"""An environment's maps as columns, so that a million of them are weighed at once."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from datetime import datetime
from typing import Self

import numpy as np
from numpy.typing import NDArray

from common.environment.model import MapEntry
from common.environment.trouble import HOURS

Array = NDArray[np.float64]
Ids = NDArray[np.int32]


@dataclass(frozen=True, slots=True)
class MapTable:
    """N maps between P places.

    Attributes:
        names: (N) of the maps.
        places: (P) names, in the order of their first mention.
        start, end: (N,) numbers of the places that each map leads from and to.
        hours: (N,) timestamps s_k, hours since the Unix epoch.
        length: (N,) metres.
        generation: (N,) n_k.
        trouble: (N, 24) by hour of the day (:mod:`common.environment.trouble`); None where no map has any.
    """

    names: Sequence[str]
    places: Sequence[str]
    start: Ids
    end: Ids
    hours: Array
    length: Array
    generation: NDArray[np.int64]
    trouble: NDArray[np.float32] | None = None

    @classmethod
    def of(cls, maps: Iterable[MapEntry]) -> Self:
        """The columns of maps, in their order."""
        entries = list(maps)
        number: dict[str, int] = {}
        ends = [
            (number.setdefault(entry.start, len(number)), number.setdefault(entry.end, len(number)))
            for entry in entries
        ]
        start, end = np.array(ends, dtype=np.int32).reshape(-1, 2).T
        return cls(
            names=[entry.name for entry in entries],
            places=list(number),
            start=np.ascontiguousarray(start),
            end=np.ascontiguousarray(end),
            hours=np.array([hours_of(entry.timestamp) for entry in entries], dtype=np.float64),
            length=np.array([entry.length for entry in entries], dtype=np.float64),
            generation=np.array([entry.generation for entry in entries], dtype=np.int64),
            trouble=_trouble([entry.trouble for entry in entries]),
        )

    def __len__(self) -> int:
        return len(self.hours)


def _trouble(rows: Sequence[Sequence[float]]) -> NDArray[np.float32] | None:
    if not any(rows):
        return None
    table = np.zeros((len(rows), HOURS), dtype=np.float32)
    for row, shares in zip(table, rows, strict=True):
        if shares:
            row[:] = shares
    return table


def hours_of(moment: datetime) -> float:
    """Hours since the Unix epoch, to less than a microsecond."""
    return moment.timestamp() / 3600.0
