"""How surely features are found again: repeatability and matching score under transformations that are known.

K. Mikolajczyk et al., *A comparison of affine region detectors*, IJCV 65, 2005. A feature of an image is found again
where one of the transformed image lies within a few pixels of its true place there and is of its size; the score counts
those whose descriptors are matched as well. Both are parts of the features that the smaller set has in the common area.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Image = NDArray[np.uint8]

TOLERANCE = 2.5
"""Pixels within which a feature is the same."""

SAME_SIZE = math.sqrt(2.0)
"""Factor within which the size of a feature is the same."""

_EDGE = 12


class View(NamedTuple):
    """An image under a known transformation.

    Attributes:
        name: what was done.
        image: (H, W), the outcome.
        mask: (H, W), zero where it shows nothing of the original, or its edge.
        transform: (2, 3), from the original's pixels to its own.
        scale: of the transform.
    """

    name: str
    image: Image
    mask: Image
    transform: Array
    scale: float


class Score(NamedTuple):
    """Parts, from 0 to 1, of the features that were found again, and of those that were matched rightly."""

    repeatability: float
    matching: float


def turned(image: Image, name: str, degrees: float, scale: float = 1.0) -> View:
    """The image turned counter-clockwise about its middle and scaled; the canvas grows only if nothing turns."""
    height, width = image.shape
    new = (round(width * scale), round(height * scale)) if degrees == 0.0 else (width, height)
    transform = cv2.getRotationMatrix2D(((width - 1) / 2, (height - 1) / 2), degrees, scale)
    transform[:, 2] += [(new[0] - width) / 2, (new[1] - height) / 2]
    # What is made smaller is smoothed first, as a lens farther away would.
    fine = cv2.GaussianBlur(image, (0, 0), 0.5 * math.sqrt(scale**-2 - 1.0)) if scale < 1.0 else image
    out = cv2.warpAffine(fine, transform, new, flags=cv2.INTER_CUBIC)
    seen = cv2.warpAffine(np.full_like(image, 255), transform, new, flags=cv2.INTER_NEAREST)
    side = 2 * _EDGE + 1
    mask = cv2.erode(seen, np.ones((side, side), np.uint8), borderType=cv2.BORDER_CONSTANT, borderValue=0)
    return View(name, np.asarray(out, np.uint8), np.asarray(mask, np.uint8), np.asarray(transform), scale)


def in_place(image: Image, name: str, changed: NDArray[np.generic]) -> View:
    """A view whose pixels are where they were."""
    clipped = np.clip(np.rint(np.asarray(changed, np.float64)), 0, 255).astype(np.uint8)
    return View(name, clipped, np.full_like(image, 255), np.eye(2, 3), 1.0)


def views(image: Image) -> Iterator[View]:
    """The views that a comparison is made over: rotation, scale, both, blur and brightness."""
    for degrees in (10.0, 30.0, 45.0, 70.0, 90.0, 135.0, 180.0):
        yield turned(image, "rotation", degrees)
    for scale in (0.5, 0.6, 0.75, 0.85, 1.2, 1.4, 1.7, 2.0):
        yield turned(image, "scale", 0.0, scale)
    yield turned(image, "rotation and scale", 20.0, 0.8)
    yield turned(image, "rotation and scale", -50.0, 1.3)
    for sigma in (1.0, 1.5, 2.0, 3.0):
        yield in_place(image, "blur", cv2.GaussianBlur(image, (0, 0), sigma))
    for gain, offset in ((0.3, 0.0), (0.5, 20.0), (1.5, 0.0), (1.0, 50.0)):
        yield in_place(image, "brightness", gain * image.astype(np.float64) + offset)


def score(first: tuple[Array, Array], second: tuple[Array, Array], pairs: NDArray[np.integer], view: View) -> Score:
    """Score of the places (N, 2) and sizes (N,) found in an image and in a view of it, and their matches (M, 2)."""
    (points, sizes), (found, found_sizes) = first, second
    expected = points @ view.transform[:, :2].T + view.transform[:, 2]
    common = _is_seen(expected, view.mask)
    most = min(int(common.sum()), len(found))
    if most == 0:
        return Score(0.0, 0.0)
    rows = np.flatnonzero(common)
    apart = np.linalg.norm(expected[rows, None] - found[None], axis=2)
    grown = np.abs(np.log(found_sizes[None] / (sizes[rows, None] * view.scale)))
    again = _one_to_one(np.where(grown <= math.log(SAME_SIZE), apart, np.inf))
    first_of, second_of = pairs[:, 0], pairs[:, 1]
    right = np.linalg.norm(expected[first_of] - found[second_of], axis=1) < TOLERANCE
    return Score(again / most, int((right & common[first_of]).sum()) / most)


def _is_seen(points: Array, mask: Image) -> NDArray[np.bool_]:
    pixels = np.rint(points).astype(np.int64)
    inside: NDArray[np.bool_] = np.all((pixels >= 0) & (pixels < [mask.shape[1], mask.shape[0]]), axis=1)
    inside[inside] = mask[pixels[inside, 1], pixels[inside, 0]] > 0
    return inside


def _one_to_one(distances: Array) -> int:
    """Pairs of a row and a column within the tolerance, the nearest first, each row and column once."""
    rows, columns = np.nonzero(distances < TOLERANCE)
    taken_rows: set[int] = set()
    taken_columns: set[int] = set()
    for k in np.argsort(distances[rows, columns], kind="stable"):
        if rows[k] not in taken_rows and columns[k] not in taken_columns:
            taken_rows.add(int(rows[k]))
            taken_columns.add(int(columns[k]))
    return len(taken_rows)
