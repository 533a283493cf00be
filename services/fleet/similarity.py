"""How alike maps look: (3.4) between several images along each, a row of the similarity matrix for each new map, (3.5).

Each map gives a few images at even shares of its length, so that the same places are compared, and one odd image (a
passer-by, a headlight) does not stand for the whole.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Self

import numpy as np
from numpy.typing import NDArray

from common.registration import Described, Prepared, Registrar
from common.registration.images import Image

Array = NDArray[np.float64]

ALONG = 4
"""Images of a map that are compared."""


def even_shares(count: int, wanted: int = ALONG) -> list[int]:
    """The numbers of at most ``wanted`` of ``count`` images, evenly along the map, its two ends among them."""
    return sorted({round(k) for k in np.linspace(0, count - 1, min(count, wanted))})


def partners(one: int, other: int) -> list[tuple[int, int]]:
    """Which images of two maps with so many are compared: each of the one that has fewer, at the same share."""
    shorter, longer = sorted((one, other))
    at = np.rint(np.linspace(0, longer - 1, shorter)).astype(int).tolist() if shorter > 1 else [0]
    pairs = list(enumerate(at))
    return pairs if one <= other else [(b, a) for a, b in pairs]


@dataclass(frozen=True, slots=True)
class Comparer:
    """Compares maps by images along them."""

    registrar: Registrar = field(default_factory=Registrar)

    def prepare(self, images: Sequence[Image | Described]) -> list[Prepared]:
        """A map's images, in the order of its length, ready to be compared.

        Raises:
            ImageError: one of them cannot be represented.
        """
        return [self.registrar.prepare(image) for image in images]

    def similarity(self, one: Sequence[Prepared], other: Sequence[Prepared]) -> float:
        """L of (3.4), in [-1, 1]: the mean over images of one map, each with that of the other at the same share.

        Raises:
            ImageError: images cannot be compared with each other.
        """
        pairs = partners(len(one), len(other))
        return float(np.mean([self.registrar.register(one[i], other[j]).score for i, j in pairs]))

    def row(self, new: Sequence[Prepared], others: Sequence[Sequence[Prepared]]) -> Array:
        """(n + 1,) the similarities of a new map to n others, and to itself last: all that the matrix needs for it."""
        return np.array([self.similarity(new, other) for other in others] + [self.similarity(new, new)])


@dataclass(frozen=True, slots=True)
class SimilarityMatrix:
    """The similarities of n maps; symmetric, one row and column longer with each new map.

    Attributes:
        names: (n) of the maps.
        hours: (n,) when they were recorded, hours since the Unix epoch.
        values: (n, n).
    """

    names: tuple[str, ...] = ()
    hours: Array = field(default_factory=lambda: np.empty(0))
    values: Array = field(default_factory=lambda: np.empty((0, 0)))

    def with_row(self, name: str, hours: float, row: Array) -> Self:
        """The matrix with one more map, whose similarities (n + 1,) end with that to itself."""
        values = np.block([[self.values, row[:-1, None]], [row[None]]])
        return type(self)((*self.names, name), np.append(self.hours, hours), values)


def softmax_rows(values: Array, beta: float) -> Array:
    """(3.5): each row (…, n) as probabilities; ``beta`` sharpens them."""
    raised = np.exp(beta * (values - values.max(axis=-1, keepdims=True)))
    rows: Array = raised / raised.sum(axis=-1, keepdims=True)
    return rows
