"""Stereo correspondence: which corner of the right image shows what a corner of the left one shows."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from common.compiled import kernel
from services.estimator.stereo import refinement
from services.estimator.stereo.settings import PreprocessingSettings

_SAME_STRUCTURE = 3
"""Corners as near to each other, in pixels, show the same thing."""


class Correspondences(NamedTuple):
    """What K left corners show in the right image.

    Attributes:
        disparity: (K,) pixels.
        slant: (K,) change of the disparity from row to row of the patch.
        variance: (K,) of the disparity, by the patch's fit, square pixels.
    """

    disparity: NDArray[np.float32]
    slant: NDArray[np.float32]
    variance: NDArray[np.float32]


@kernel
def _row_starts(places: NDArray[np.int32], height: int) -> NDArray[np.int64]:
    """Index of the first place of every row; the places come in reading order."""
    starts = np.zeros(height + 1, np.int64)
    for i in range(places.shape[0]):
        starts[places[i, 1] + 1] += 1
    return np.cumsum(starts)


@kernel
def _best_in_row(
    left: NDArray[np.uint8],
    right: NDArray[np.uint8],
    corner: NDArray[np.int32],
    corners_right: NDArray[np.int32],
    first: int,
    last: int,
    max_disparity: float,
    threshold: float,
) -> tuple[int, float, float]:
    """Of the right corners from ``first`` to ``last`` the best one (-1: none), its correlation and its rival's."""
    u, v = int(corner[0]), int(corner[1])
    best, rival, chosen, chosen_x = threshold, -1.0, -1, 0
    for j in range(first, last):
        x = int(corners_right[j, 0])
        if x > u + 1 or u - x > max_disparity:
            continue
        score = refinement.correlation(left, u, v, right, x, int(corners_right[j, 1]))
        # The same structure seen by a neighbouring corner is no rival.
        apart = chosen >= 0 and abs(chosen_x - x) > _SAME_STRUCTURE
        if score > best:
            if apart:
                rival = best
            best, chosen, chosen_x = score, j, x
        elif apart and score > rival:
            rival = score
    return chosen, best, rival


@kernel
def _candidates(
    left: NDArray[np.uint8],
    right: NDArray[np.uint8],
    corners_left: NDArray[np.int32],
    corners_right: NDArray[np.int32],
    max_disparity: float,
    rows: int,
    min_correlation: float,
    uniqueness: float,
) -> NDArray[np.int64]:
    """Index (N,) of the right corner that each left corner matches, -1 where none does, unambiguously and mutually."""
    n, height = corners_left.shape[0], left.shape[0]
    match = np.full(n, -1, np.int64)
    owner, owner_score = np.full(corners_right.shape[0], -1, np.int64), np.zeros(corners_right.shape[0])
    starts = _row_starts(corners_right, height)
    for i in range(n):
        first, last = starts[max(corners_left[i, 1] - rows, 0)], starts[min(corners_left[i, 1] + rows + 1, height)]
        chosen, best, rival = _best_in_row(
            left, right, corners_left[i], corners_right, first, last, max_disparity, min_correlation
        )
        if chosen < 0 or 1.0 - best > uniqueness * (1.0 - rival) or best <= owner_score[chosen]:
            continue
        if owner[chosen] >= 0:
            match[owner[chosen]] = -1
        owner[chosen], owner_score[chosen] = i, best
        match[i] = chosen
    return match


def correspond(
    left: NDArray[np.uint8],
    right: NDArray[np.uint8],
    corners_left: NDArray[np.int32],
    corners_right: NDArray[np.int32],
    settings: PreprocessingSettings,
) -> tuple[NDArray[np.int64], Correspondences]:
    """Stereo correspondences of corners (N, 2) and (M, 2), each ``[x, y]`` in reading order.

    Returns the indices (K,) of the left corners that have one, and their disparities. Candidates are
    the right image's corners along the row, compared by patch; the place in the right image is then refined to a
    fraction of a pixel in both directions, so that an edge that crosses the row at a slant does not turn a vertical
    offset of the cameras into a disparity.
    """
    match = _candidates(
        left, right, corners_left, corners_right,
        settings.max_disparity, int(np.ceil(settings.row_tolerance)), settings.min_correlation, settings.uniqueness,
    )  # fmt: skip
    matched = np.flatnonzero(match >= 0)
    places = corners_left[matched]
    starts = corners_right[match[matched]].astype(np.float32)
    refined = refinement.align_pair(refinement.extract(left, places), right, starts, 10)
    disparity = places[:, 0].astype(np.float32) - refined[:, 0]
    good = (
        (refined[:, 2] >= settings.min_correlation)
        & (np.abs(refined[:, 0] - starts[:, 0]) < 2.0)
        & (np.abs(refined[:, 1] - places[:, 1]) < settings.row_tolerance)
        & (disparity > 0.0)
    )
    return matched[good], Correspondences(disparity[good], refined[good, 3], refined[good, 4])
