"""The classical representation: how often gradients point which way, in each cell of a fine grid of columns.

Snow, leaves and the sun change what is bright and what is dark, and how much, but hardly where trunks, walls and the
skyline run, nor their direction. So the strength of a gradient counts little beside its direction (the fourth root,
after division by the strength around it), and a direction and its opposite are one. Cells are narrow, since the
columns hold the shift, and tall, since rows only have to tell ground from crowns from sky.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from common.compiled import kernel
from common.registration import images
from common.registration.images import Image
from common.registration.representation import Described, Values

Array = NDArray[np.float32]


@dataclass(frozen=True, slots=True)
class GradientSettings:
    """The grid and its channels; lengths are in pixels of the image at its working width, unless said otherwise.

    Attributes:
        width: working width.
        directions: channels: directions of a gradient over half a turn.
        column: width of a cell.
        row: distance of the rows of cells; a cell weighs what lies about its row by a Gaussian of that deviation.
        smoothing: standard deviation of the cell's Gaussian along the row.
        neighbourhood: size of the square whose mean strength a gradient's own is divided by.
        noise: gradient, in grey levels a pixel, below which strength means nothing.
        peak, surround: standard deviations, in cells, of the bumps that sharpen a row: it is seen against its
            surroundings, so that a slow change across the image (the sun to one side, haze) weighs little.
        contrast: how much of the surroundings is taken away, 1 for all.
    """

    width: int = 512
    directions: int = 6
    column: int = 2
    row: int = 12
    smoothing: float = 3.0
    neighbourhood: int = 57
    noise: float = 1.0
    peak: float = 2.0
    surround: float = 12.0
    contrast: float = 0.7


OF_THUMBNAILS = GradientSettings(width=192, column=3, row=12, smoothing=2.0, neighbourhood=23, peak=1.5, surround=8.0)
"""For small pictures, of which only the likeness is asked: a fifteenth of the cells, and the same rhythm found."""


@dataclass(frozen=True, slots=True)
class GradientRepresentation:
    """Oriented gradients over a grid, from grey levels alone: colours change with the season most of all."""

    settings: GradientSettings = GradientSettings()

    @property
    def name(self) -> str:
        """The settings' own name: representations of other settings do not compare."""
        s = self.settings
        values = (s.width, s.directions, s.column, s.row, s.smoothing, s.neighbourhood, s.noise)
        return "gradients-" + "-".join(f"{value:g}" for value in (*values, s.peak, s.surround, s.contrast))

    def describe(self, image: Image) -> Described:
        """The representation of an image (H, W) or (H, W, 3) RGB.

        Raises:
            ImageError: it is no such image.
        """
        image = images.check(image)
        s = self.settings
        small = images.resized(images.grey(image), s.width)
        height = small.shape[0]
        directed = directed_strength(small, s)
        rows = _row_weights(height, max(1, round(height / s.row)), float(s.row))
        bands: Array = (rows @ directed.reshape(height, -1)).reshape(len(rows), s.directions, s.width)
        pooled: Array = bands @ _column_weights(s.width, s.column, s.smoothing)
        values = _against_surroundings(_evened(pooled.transpose(1, 0, 2)), s)
        cell_height = height / len(rows) / s.width
        return Described(values, image.shape[1], image.shape[0], cell_height, self.name)


def directed_strength(grey: Image, settings: GradientSettings) -> Array:
    """Normalised strength of each pixel's gradient, shared between the two directions nearest its own: (h, d, w)."""
    smooth = np.asarray(cv2.GaussianBlur(grey, (3, 3), 0.5), dtype=np.float32)
    right = np.asarray(cv2.Scharr(smooth, cv2.CV_32F, 1, 0, scale=1 / 32), dtype=np.float32)
    down = np.asarray(cv2.Scharr(smooth, cv2.CV_32F, 0, 1, scale=1 / 32), dtype=np.float32)
    strength, angle = (np.asarray(part, dtype=np.float32) for part in cv2.cartToPolar(right, down))
    around = np.asarray(cv2.blur(strength, (settings.neighbourhood, settings.neighbourhood)), dtype=np.float32)
    return _share(strength, angle, around, settings.noise, settings.directions)


@kernel
def _share(strength: Array, angle: Array, around: Array, noise: float, directions: int) -> Array:
    height, width = strength.shape
    out = np.zeros((height, directions, width), np.float32)
    scale = directions / np.pi
    for y in range(height):
        for x in range(width):
            level = np.sqrt(np.sqrt(strength[y, x] / (around[y, x] + noise)))
            place = angle[y, x] * scale
            lower = int(place)
            upper_share = np.float32(place - lower)
            out[y, lower % directions, x] += level * (1 - upper_share)
            out[y, (lower + 1) % directions, x] += level * upper_share
    return out


def _evened(pooled: Array) -> Array:
    """The channels (d, h, w) with cells of strong and of weak texture brought half-way together."""
    strength = np.sqrt((pooled * pooled).sum(axis=0))
    evened: Array = pooled / np.sqrt(strength / max(float(np.median(strength)), 1e-6) + 0.2)
    return evened


def _against_surroundings(pooled: Array, settings: GradientSettings) -> Values:
    weights = _sharpening(pooled.shape[2], settings.peak, settings.surround, settings.contrast)
    rows = (pooled - pooled.mean(axis=2, keepdims=True)) @ weights
    return np.ascontiguousarray(rows, dtype=np.float32)


@lru_cache(maxsize=8)
def _row_weights(height: int, count: int, sigma: float) -> Array:
    """(count, height): each row of cells' weights over the image's rows."""
    return _normalised(_gaussians((np.arange(count, dtype=np.float64) + 0.5) * height / count - 0.5, height, sigma))


@lru_cache(maxsize=8)
def _column_weights(width: int, step: int, sigma: float) -> Array:
    """(width, cells): each column of cells' weights over the image's columns."""
    centres = (np.arange(width // step, dtype=np.float64) + 0.5) * step - 0.5
    return np.ascontiguousarray(_normalised(_gaussians(centres, width, sigma)).T)


@lru_cache(maxsize=8)
def _sharpening(cells: int, peak: float, surround: float, contrast: float) -> Array:
    """(cells, cells): a row times this is seen against its surroundings."""
    places = np.arange(cells, dtype=np.float64)
    near, far = (_normalised(_gaussians(places, cells, sigma)).T for sigma in (peak, surround))
    own = np.eye(cells, dtype=np.float32) + near
    return np.ascontiguousarray(own - contrast * own.sum(axis=0).mean() * far, dtype=np.float32)


def _gaussians(centres: NDArray[np.float64], length: int, sigma: float) -> NDArray[np.float64]:
    weights: NDArray[np.float64] = np.exp(-0.5 * ((np.arange(length) - centres[:, None]) / sigma) ** 2)
    return weights


def _normalised(weights: NDArray[np.float64]) -> Array:
    return np.ascontiguousarray(weights / weights.sum(axis=1, keepdims=True), dtype=np.float32)
