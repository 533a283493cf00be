"""Random fields and spots that tile: what natural textures are made of."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

Image = NDArray[np.float32]


def fractal(rng: np.random.Generator, size: int, shortest: float, longest: float, slope: float = 1.0) -> Image:
    """A periodic Gaussian field (size, size) of mean 0 and deviation 1.

    Its wavelengths lie between ``shortest`` and ``longest`` pixels; amplitude grows with wavelength to the
    power ``slope``. Made in the frequency domain, so that it tiles.
    """
    fx, fy = np.fft.rfftfreq(size).astype(np.float32), np.fft.fftfreq(size).astype(np.float32)
    frequency = np.hypot(fx[None, :], fy[:, None])
    frequency[0, 0] = 1.0
    # One power more, because a ring of the plane holds the more waves the greater its radius.
    gain = frequency ** -np.float32(slope + 1.0) * ((frequency >= 1.0 / longest) & (frequency <= 1.0 / shortest))
    gain[0, 0] = 0.0
    white = np.fft.rfft2(rng.standard_normal((size, size), dtype=np.float32))
    field = np.fft.irfft2(white * gain, s=(size, size)).astype(np.float32)
    return np.asarray((field - field.mean()) / field.std())


def contrast(field: Image, gain: float = 1.0) -> Image:
    """A field of deviation 1 brought into 0..1 by a logistic curve; a high gain makes sharp patches."""
    return np.asarray(1.0 / (1.0 + np.exp(-gain * field)))


def _wrapped(centre: Sequence[float], reach: float, size: int) -> list[tuple[int, int]]:
    """The places on the canvas where something of a radius must be drawn so that the canvas tiles."""
    if reach < centre[0] < size - reach and reach < centre[1] < size - reach:
        return [(round(16 * centre[0]), round(16 * centre[1]))]
    shifts = [(dx, dy) for dx in (-size, 0, size) for dy in (-size, 0, size)]
    near = [(centre[0] + dx, centre[1] + dy) for dx, dy in shifts]
    inside = [p for p in near if -reach < p[0] < size + reach and -reach < p[1] < size + reach]
    return [(round(16 * x), round(16 * y)) for x, y in inside]


def spots(
    canvas: Image, rng: np.random.Generator, count: int, radius: tuple[float, float], level: tuple[float, float]
) -> None:
    """Draw ``count`` random ellipses on a periodic canvas, small ones more often, in place."""
    size = canvas.shape[0]
    centres = (rng.random((count, 2)) * size).tolist()
    radii = radius[0] * (radius[1] / radius[0]) ** rng.random(count) ** 1.5
    flat, angle, grey = rng.uniform(0.5, 1.0, count), rng.uniform(0.0, 180.0, count), rng.uniform(*level, count)
    for i in range(count):
        axes = (max(1, round(16 * radii[i])), max(1, round(16 * radii[i] * flat[i])))
        for x, y in _wrapped(centres[i], radii[i], size):
            cv2.ellipse(canvas, (x, y), axes, angle[i], 0, 360, float(grey[i]), -1, cv2.LINE_AA, 4)


def strokes(
    canvas: Image,
    rng: np.random.Generator,
    count: int,
    length: tuple[float, float],
    level: tuple[float, float],
    heading: float = np.pi,
) -> None:
    """Draw ``count`` random blades on a periodic canvas, in place.

    Their directions differ from the canvas's x axis by at most ``heading`` radians.
    """
    size = canvas.shape[0]
    starts, angles = (rng.random((count, 2)) * size).tolist(), rng.uniform(-heading, heading, count)
    lengths, grey = rng.uniform(*length, count), rng.uniform(*level, count)
    wide = rng.random(count) < 0.3
    for i in range(count):
        dx, dy = round(16 * lengths[i] * np.cos(angles[i])), round(16 * lengths[i] * np.sin(angles[i]))
        for x, y in _wrapped(starts[i], lengths[i], size):
            cv2.line(canvas, (x, y), (x + dx, y + dy), float(grey[i]), 2 if wide[i] else 1, cv2.LINE_AA, 4)
