"""Taught actions: what was commanded where, kept with each vertex and laid along a route."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from common.geometry import Array

COLUMNS = 4
"""Of a vertex's actions (K, 4): metres and seconds since the vertex before, then m/s and rad/s as commanded."""

_LONGEST = 5000
"""Actions that are kept between two vertices: a robot may stand for minutes."""


class ActionLog:
    """The actions since the last vertex."""

    def __init__(self) -> None:
        self._rows: deque[tuple[float, float, float, float]] = deque(maxlen=_LONGEST)
        self._metres = 0.0
        self._seconds = 0.0

    def move(self, metres: float, seconds: float) -> None:
        """Takes the way and the time on to the next frame."""
        self._metres += metres
        self._seconds += seconds

    def add(self, v: float, w: float, ahead: float, later: float) -> None:
        """A command (m/s, rad/s) that the robot obeyed ``ahead`` metres and ``later`` seconds after the last frame."""
        self._rows.append((self._metres + ahead, self._seconds + later, v, w))

    def take(self) -> NDArray[np.float32]:
        """The actions (K, 4) since the vertex before; the next are counted from here."""
        rows = np.array(self._rows, dtype=np.float32).reshape(-1, COLUMNS)
        self._rows.clear()
        self._metres = self._seconds = 0.0
        return rows


def along(actions: Sequence[NDArray[np.float32] | None], metres: Array) -> Array:
    """Actions (K, 3) ``[metres, v, w]`` along a route with N vertices at distances ``metres`` (N,), ascending.

    ``actions[i]`` were obeyed on the way to vertex i; None where they are not at hand. The way that wheels counted
    between two vertices is scaled to the route's, which is made of chords.
    """
    parts = [np.zeros((0, 3))]
    for i in range(1, len(metres)):
        rows = actions[i]
        if rows is None or len(rows) == 0:
            continue
        step = metres[i] - metres[i - 1]
        driven = max(float(rows[-1, 0]), 1e-6)
        scale = min(step / driven, 1.5)
        parts.append(np.column_stack([metres[i - 1] + scale * rows[:, 0], rows[:, 2:4]]))
    laid = np.concatenate(parts)
    return laid[np.argsort(laid[:, 0], kind="stable")]
