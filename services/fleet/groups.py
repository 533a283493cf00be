"""Maps that are compared with each other: between the same two places, with images of one kind.

How alike two routes look says nothing of the time of day, and a large environment has many routes; so each has a matrix
of its own, and all of them are searched for rhythms jointly. A matrix holds the newest maps of its route up to a limit:
an older one's rhythms are known by then, and the cost of a new map stays bounded.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from common.environment.metadata import MapMetadata
from services.fleet.rows import Images
from services.fleet.similarity import ALONG, even_shares

Bytes = NDArray[np.int8]
Array = NDArray[np.float64]

_FIRST_SIZE = 8


class Kind(NamedTuple):
    """What two images must have in common to be compared.

    Attributes:
        name: of the representation.
        channels, rows, columns: its shape.
        aspect: thousandths of the image's height that its width is.
    """

    name: str
    channels: int
    rows: int
    columns: int
    aspect: int


Key = tuple[Kind, str, str]
"""What the maps of a group have in common: the kind of their images, and the places that they lead from and to."""


@dataclass(frozen=True, slots=True)
class Along:
    """A map's images along it: their kind, values (p, c, h, w), and the height of a cell in widths of the image."""

    kind: Kind
    values: Bytes
    cell_height: float

    @classmethod
    def of(cls, metadata: MapMetadata) -> Self | None:
        """Those that metadata hold, a few of them evenly along the map; None where there is nothing to compare.

        Raises:
            ValueError: they are of different kinds.
        """
        if not metadata.images:
            return None
        images = [metadata.images[k] for k in even_shares(len(metadata.images), ALONG)]
        kinds = {Kind(image.name, *image.shape, round(1000 * image.width / image.height)) for image in images}
        if len(kinds) > 1:
            raise ValueError("its images are of different kinds, so that they cannot be compared with other maps'")
        values = np.stack([np.frombuffer(image.values, dtype=np.int8).reshape(image.shape) for image in images])
        return cls(kinds.pop(), values, images[0].cell_height)


class Group:
    """The similarities of the newest maps of one route; symmetric, a row for each new map.

    Every map has a slot, its row and column in ``matrix`` and its place among ``images``, which the next one takes
    when it leaves.
    """

    def __init__(self, key: Key, limit: int) -> None:
        """``key`` is what its maps have in common, ``limit`` the most maps that it holds."""
        self.key = key
        self._limit = limit
        self._slots: dict[str, int] = {}
        self._hours: dict[str, float] = {}
        self._matrix = np.full((_FIRST_SIZE, _FIRST_SIZE), np.nan)

    def __len__(self) -> int:
        return len(self._slots)

    def __contains__(self, map_id: object) -> bool:
        return map_id in self._slots

    @property
    def ids(self) -> list[str]:
        """The maps, in the order of their ids, which is that of their times."""
        return sorted(self._slots)

    def slots(self) -> dict[str, int]:
        """The maps' slots."""
        return dict(self._slots)

    def add(self, map_id: str, hours: float, names: Sequence[str], values: Array) -> bool:
        """Adds a map, recorded at ``hours``, with its similarities to itself and to ``names``.

        False where these do not tell of every map that is there: then nothing is changed.
        """
        known = dict(zip(names, values.tolist(), strict=True))
        if map_id in self or not {*self._slots, map_id} <= known.keys():
            return map_id in self
        if len(self) >= self._limit:
            self._leave(min(self._slots))
        slot = self._free()
        others = [*self._slots, map_id]
        self._slots[map_id] = slot
        self._hours[map_id] = hours
        places = [self._slots[name] for name in others]
        self._matrix[slot, places] = self._matrix[places, slot] = [known[name] for name in others]
        return True

    def remove(self, ids: set[str]) -> None:
        """Takes out maps that are stored no longer."""
        for map_id in ids & self._slots.keys():
            self._leave(map_id)

    def matrix(self, newest: int | None = None) -> tuple[list[str], Array, Array]:
        """Names, hours (n,) and similarities (n, n) of all maps, or of the newest, in the order of their ids."""
        names = self.ids[-newest:] if newest is not None else self.ids
        slots = [self._slots[name] for name in names]
        return names, np.array([self._hours[name] for name in names]), self._matrix[np.ix_(slots, slots)]

    def _leave(self, map_id: str) -> None:
        slot = self._slots.pop(map_id)
        del self._hours[map_id]
        self._matrix[slot] = self._matrix[:, slot] = np.nan

    def _free(self) -> int:
        taken = set(self._slots.values())
        slot = next(k for k in range(len(taken) + 1) if k not in taken)
        if slot == len(self._matrix):
            grown = np.full((2 * slot, 2 * slot), np.nan)
            grown[:slot, :slot] = self._matrix
            self._matrix = grown
        return slot


class Bank:
    """The images of a group's maps, each in its slot."""

    def __init__(self, kind: Kind) -> None:
        shape = (kind.channels, kind.rows, kind.columns)
        self._values = np.zeros((_FIRST_SIZE, ALONG, *shape), dtype=np.int8)
        self._counts = np.zeros(_FIRST_SIZE, dtype=np.int64)

    def put(self, slot: int, values: Bytes) -> None:
        """Keeps a map's images (p, c, h, w)."""
        while slot >= len(self._counts):
            self._values, self._counts = _twice(self._values), _twice(self._counts)
        self._values[slot, : len(values)] = values
        self._counts[slot] = len(values)

    def take(self, slots: Sequence[int]) -> Images:
        """Those of some slots, ascending; without a copy where these follow each other."""
        where = list(slots)
        if where and where == list(range(where[0], where[0] + len(where))):
            return Images(self._values[where[0] : where[-1] + 1], self._counts[where[0] : where[-1] + 1])
        return Images(self._values[where], self._counts[where])


def _twice(array: NDArray[Any]) -> NDArray[Any]:
    """A copy of twice the length; the new part takes no memory until it is written to."""
    longer = np.zeros((2 * len(array), *array.shape[1:]), dtype=array.dtype)
    longer[: len(array)] = array
    return longer
