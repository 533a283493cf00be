"""FAST-9 corners, spread evenly over the image.

E. Rosten and T. Drummond, *Machine learning for high-speed corner detection*, ECCV 2006: a pixel is a corner when 9
contiguous pixels of the circle of 16 around it are all brighter, or all darker, than it by the threshold. The
threshold is low and the best corners of every cell are kept, so that shade has features as well as light.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from common.compiled import kernel

BORDER = 17
"""Pixels at the image's edge without features: a descriptor's reach, and a pixel for refinement on either side."""

_CIRCLE_X = np.array([0, 1, 2, 3, 3, 3, 2, 1, 0, -1, -2, -3, -3, -3, -2, -1], dtype=np.int64)
_CIRCLE_Y = np.array([-3, -3, -2, -1, 0, 1, 2, 3, 3, 3, 2, 1, 0, -1, -2, -3], dtype=np.int64)


def _contrast_bound(image: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """For every pixel a threshold above which it cannot be a corner; 0 along the border.

    Of each two opposite pixels every arc of 9 holds one, so the arc's least contrast is at most the larger contrast
    of each pair. A few operations on whole images dismiss nearly all pixels.
    """
    height, width = image.shape
    b = BORDER

    def shifted(k: int) -> NDArray[np.uint8]:
        dx, dy = int(_CIRCLE_X[k]), int(_CIRCLE_Y[k])
        return image[b + dy : height - b + dy, b + dx : width - b + dx]

    bright, dark = cv2.max(shifted(0), shifted(8)), cv2.min(shifted(0), shifted(8))
    for k in range(1, 8):
        bright = cv2.min(bright, cv2.max(shifted(k), shifted(k + 8)))
        dark = cv2.max(dark, cv2.min(shifted(k), shifted(k + 8)))
    centre = image[b : height - b, b : width - b]
    bound = np.zeros_like(image)
    bound[b : height - b, b : width - b] = cv2.max(cv2.subtract(bright, centre), cv2.subtract(centre, dark))
    return bound


@kernel
def _has_arc(mask: int) -> bool:
    """Whether 9 contiguous of 16 bits, on a circle, are set."""
    doubled = mask | (mask << 16)
    pairs = doubled & (doubled >> 1)
    fours = pairs & (pairs >> 2)
    eights = fours & (fours >> 4)
    return (eights & (doubled >> 8)) != 0


@kernel
def _score(pixels: NDArray[np.uint8], at: np.uint64, offsets: NDArray[np.uint64], threshold: int) -> int:
    """Sum of the contrast beyond the threshold over the circle, 0 where there is no corner."""
    # Signed: the difference of two bytes may be negative.
    centre = np.int64(pixels[at])
    sum_bright = sum_dark = np.int64(0)
    mask_bright = mask_dark = 0
    for k in range(16):
        difference = np.int64(pixels[at + offsets[k]]) - centre
        mask_bright |= int(difference > threshold) << k
        mask_dark |= int(difference < -threshold) << k
        if difference > threshold:
            sum_bright += difference - threshold
        elif difference < -threshold:
            sum_dark -= difference + threshold
    if _has_arc(mask_bright):
        return int(sum_bright)
    return int(sum_dark) if _has_arc(mask_dark) else 0


@kernel
def _corners(
    image: NDArray[np.uint8], bound: NDArray[np.uint8], threshold: int
) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """Places (N, 2) and scores (N,) of the corners that no neighbour of the 8 exceeds, in reading order."""
    height, width = image.shape
    scores = np.zeros((height, width), np.int16)
    found = np.empty((height * width, 2), np.int32)
    pixels = image.ravel()
    # Unsigned, wrapping offsets spare the loop the tests of a negative index.
    offsets = (_CIRCLE_Y * width + _CIRCLE_X).astype(np.uint64)
    n = 0
    for y in range(BORDER, height - BORDER):
        for x in range(BORDER, width - BORDER):
            if bound[y, x] > threshold:
                score = _score(pixels, np.uint64(y * width + x), offsets, threshold)
                if score > 0:
                    scores[y, x] = score
                    found[n, 0], found[n, 1] = x, y
                    n += 1
    places = np.empty((n, 2), np.int32)
    values = np.empty(n, np.int32)
    kept = 0
    for i in range(n):
        x, y = int(found[i, 0]), int(found[i, 1])
        s = scores[y, x]
        # Of equal neighbours the one read first stays, so a plateau leaves one corner.
        before = max(scores[y - 1, x - 1], scores[y - 1, x], scores[y - 1, x + 1], scores[y, x - 1])
        after = max(scores[y, x + 1], scores[y + 1, x - 1], scores[y + 1, x], scores[y + 1, x + 1])
        if s > before and s >= after:
            places[kept, 0], places[kept, 1], values[kept] = x, y, s
            kept += 1
    return places[:kept].copy(), values[:kept].copy()


@kernel
def _spread(places: NDArray[np.int32], order: NDArray[np.int64], cell: int, limit: int) -> NDArray[np.bool_]:
    """Choose at most ``limit`` places: the best of every cell, then the second best of every cell, and so on."""
    n = places.shape[0]
    rank = np.zeros(n, np.int64)
    counts = np.zeros((places[:, 1].max() // cell + 1, places[:, 0].max() // cell + 1), np.int64)
    histogram = np.zeros(n + 1, np.int64)
    for i in order:
        row, column = places[i, 1] // cell, places[i, 0] // cell
        rank[i] = counts[row, column]
        counts[row, column] += 1
        histogram[rank[i]] += 1
    last, total = 0, 0
    while last < n and total + histogram[last] <= limit:
        total += histogram[last]
        last += 1
    chosen = rank < last
    for i in order:
        if total < limit and rank[i] == last:
            chosen[i] = True
            total += 1
    return chosen


def detect(image: NDArray[np.uint8], threshold: int, *, cell: int, limit: int | None) -> NDArray[np.int32]:
    """Corners (N, 2) as ``[x, y]`` in pixels, in reading order, at least :data:`BORDER` pixels from the edge.

    ``threshold`` is the least contrast in grey levels, ``cell`` the side of a cell in pixels, ``limit`` the most
    corners returned, the best of every cell first (None: all of them).
    """
    if min(image.shape) <= 2 * BORDER:
        return np.empty((0, 2), dtype=np.int32)
    places, values = _corners(image, _contrast_bound(image), threshold)
    if limit is None or len(places) <= limit:
        return places
    return np.ascontiguousarray(places[_spread(places, np.argsort(-values, kind="stable"), cell, limit)])
