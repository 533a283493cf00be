"""Which of the maxima become features: inside the image and the mask, spread, the strongest first."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from services.estimator.surf.detector import Blobs
from services.estimator.surf.settings import SurfSettings


def select(
    blobs: Blobs, shape: tuple[int, int], settings: SurfSettings, mask: NDArray[np.uint8] | None, *, wrap: bool
) -> Blobs:
    """At most ``max_features`` of the blobs of an image of that shape, the strongest first."""
    height, width = shape
    points = blobs.points.copy()
    distance = settings.margin * blobs.scales
    inside = np.minimum(points[:, 1], height - 1 - points[:, 1]) >= distance
    if wrap:
        points[:, 0] %= width
    else:
        inside &= np.minimum(points[:, 0], width - 1 - points[:, 0]) >= distance
    rows = np.flatnonzero(inside)
    if mask is not None:
        pixels = np.rint(points[rows]).astype(np.int64)
        rows = rows[mask[np.clip(pixels[:, 1], 0, height - 1), pixels[:, 0] % width] != 0]
    rows = rows[np.argsort(-blobs.responses[rows], kind="stable")]
    if settings.cell is not None and len(rows) > settings.max_features:
        rows = rows[_spread(points[rows], settings.cell, settings.max_features)]
    rows = rows[: settings.max_features]
    return Blobs(points[rows], blobs.scales[rows], blobs.responses[rows], blobs.laplacians[rows])


def _spread(points: NDArray[np.float64], cell: int, limit: int) -> NDArray[np.int64]:
    """Of points in the order of their strength, the best of every cell, then every second best, and so on."""
    column, row = np.floor(points.T / cell).astype(np.int64)
    cells = (row - row.min()) * (column.max() - column.min() + 1) + column - column.min()
    order = np.argsort(cells, kind="stable")
    ordered = cells[order]
    rank = np.empty(len(points), np.int64)
    rank[order] = np.arange(len(points)) - np.searchsorted(ordered, ordered)
    return np.sort(np.argsort(rank, kind="stable")[:limit])
