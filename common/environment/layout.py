"""Where an environment's places stand in a drawing: nobody has measured that, but maps have lengths."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from common.environment.table import MapTable

Array = NDArray[np.float64]

_ROUNDS = 300


def places_in_plane(maps: MapTable, used: NDArray[np.int64], shown: NDArray[np.int64]) -> Array:
    """Points (P, 2), metres, of the places ``used`` (P,), as far from each other as the maps ``shown`` (E,) are long.

    Stress majorisation of the distances along maps, from a circle (Gansner, Koren & North, *Graph Drawing*, 2004): the
    same maps are always drawn alike. Both ends of every shown map are among the used places.
    """
    index = {place: k for k, place in enumerate(used.tolist())}
    distance = _distances(maps, index, shown)
    count = len(used)
    angle = 2.0 * math.pi * np.arange(count) / max(count, 1)
    points: Array = 0.5 * float(distance.max(initial=0.0)) * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    weights = np.where(distance > 0.0, 1.0 / np.maximum(distance, 1e-9) ** 2, 0.0)
    for _ in range(_ROUNDS):
        apart = points[:, None] - points
        size = np.linalg.norm(apart, axis=2)
        wished = points + apart * np.divide(distance, size, out=np.zeros_like(size), where=size > 0.0)[..., None]
        means = (weights[..., None] * wished).sum(axis=1) / np.maximum(weights.sum(axis=1), 1e-12)[:, None]
        points = 0.5 * (points + means)  # all move at once, and would overshoot
    return points


def _distances(maps: MapTable, index: dict[int, int], shown: NDArray[np.int64]) -> Array:
    """(P, P) the shortest ways along maps in either direction; places that none joins stand apart."""
    count = len(index)
    distance = np.full((count, count), np.inf)
    np.fill_diagonal(distance, 0.0)
    for k in shown.tolist():
        a, b = index[int(maps.start[k])], index[int(maps.end[k])]
        if a != b:
            distance[a, b] = distance[b, a] = min(distance[a, b], max(float(maps.length[k]), 1e-3))
    for middle in range(count):
        distance = np.minimum(distance, distance[:, middle, None] + distance[middle])
    finite = distance[np.isfinite(distance)]
    distance[~np.isfinite(distance)] = 1.5 * max(float(finite.max(initial=0.0)), 1.0)
    return distance
