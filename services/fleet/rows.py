"""A row of the similarity matrix at once: (3.4) of one new map with many others.

The same numbers as :class:`services.fleet.similarity.Comparer` to rounding, in a third of the time and an eighth of
the memory: stored maps stay what their metadata holds, a byte a value; a few at a time are transformed, by a Fourier
transform just long enough for the largest shift, and multiplied with the new map's at all vertical offsets together.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from common.compiled import kernel
from common.registration import Registrar
from common.registration.correlation import VERTICAL_REACH, fading
from services.fleet.similarity import ALONG, partners

Bytes = NDArray[np.int8]
Array = NDArray[np.float64]
Floats = NDArray[np.float32]

_AT_ONCE = 8
"""Images that are transformed together: their transforms stay in the processor's second cache."""


@dataclass(frozen=True, slots=True)
class Images:
    """The images of K maps of one kind, a byte a value.

    Attributes:
        values: (K, ALONG, c, h, w); of a map with fewer images the first ones are filled.
        counts: (K,) how many each map has, 1 to ALONG.
    """

    values: Bytes
    counts: NDArray[np.int64]

    @classmethod
    def of(cls, values: Bytes) -> Images:
        """One map's own, from its images (p, c, h, w)."""
        padded = np.zeros((1, ALONG, *values.shape[1:]), dtype=np.int8)
        padded[0, : len(values)] = values
        return cls(padded, np.array([len(values)]))

    def __len__(self) -> int:
        return len(self.counts)


def row(new: Bytes, others: Images, cell_height: float, max_shift: float = Registrar().max_shift) -> Array:
    """(K,) the similarity of a map's images (p, c, h, w) to each of K maps; ``cell_height`` in widths of the image."""
    reach = max(1, int(max_shift * new.shape[3]))
    offsets = min(int(VERTICAL_REACH / cell_height), new.shape[2] - 1)
    prepared = [_Prepared.of(image, reach, offsets) for image in new]
    similarities = np.empty(len(others))
    for count in np.unique(others.counts).tolist():
        chosen = np.flatnonzero(others.counts == count)
        pairs = partners(len(new), count)
        scores = [_scores(prepared[i], others.values[:, j], chosen) for i, j in pairs]
        similarities[chosen] = np.mean(scores, axis=0)
    return similarities


@dataclass(frozen=True, slots=True)
class _Prepared:
    """A new map's image: real and imaginary part of its transform (c, h, f), and its overlap's energy at each shift."""

    real: Floats
    imaginary: Floats
    overlap: Array
    offsets: int

    @classmethod
    def of(cls, image: Bytes, reach: int, offsets: int) -> _Prepared:
        length = fft.next_fast_len(image.shape[2] + reach, real=True)
        faded, energy = _faded(image[None], _fade(image.shape[2]), length)
        spectrum = fft.rfft(faded[0])
        overlap = _overlap(energy, np.arange(-reach, reach + 1))[0]
        return cls(np.ascontiguousarray(spectrum.real), np.ascontiguousarray(spectrum.imag), overlap, offsets)


def _scores(new: _Prepared, stored: Bytes, chosen: NDArray[np.int64]) -> Array:
    """The best similarity over all shifts with each chosen one of the stored images (K, c, h, w)."""
    width = stored.shape[3]
    shifts = np.arange(len(new.overlap)) - len(new.overlap) // 2
    length = fft.next_fast_len(width + int(shifts[-1]), real=True)
    fade, scores = _fade(width), np.empty(len(chosen))
    for begin in range(0, len(chosen), _AT_ONCE):
        faded, energy = _faded(stored[chosen[begin : begin + _AT_ONCE]], fade, length)
        spectrum = fft.rfft(faded).astype(np.complex64, copy=False).view(np.float32)
        products = fft.irfft(_products(new.real, new.imaginary, spectrum, new.offsets), length)
        best = products[:, :, shifts].max(axis=1).astype(np.float64)
        overlap = new.overlap * _overlap(energy, -shifts)
        curves = np.divide(best, np.sqrt(overlap), out=np.zeros_like(best), where=overlap > 0.0)
        scores[begin : begin + _AT_ONCE] = _peaks(curves)
    return scores


def _fade(width: int) -> Floats:
    return fading(width).astype(np.float32)


def _overlap(energy: Array, shifts: NDArray[np.int64]) -> Array:
    """(K, shifts) energy of the columns that have a partner, of running sums (K, w + 1)."""
    last = energy.shape[1] - 1
    part: Array = energy[:, np.minimum(last, last + shifts)] - energy[:, np.maximum(0, shifts)]
    return part


def _peaks(curves: Array) -> Array:
    """(K,) the height of the parabola through the highest value of each curve and its neighbours, at most 1."""
    rows, best = np.arange(len(curves)), curves.argmax(axis=1)
    inner = np.clip(best, 1, curves.shape[1] - 2)
    before, peak, after = (curves[rows, inner + k] for k in (-1, 0, 1))
    bend = before - 2.0 * peak + after
    curved = (inner == best) & (bend < 0.0)
    fraction = np.divide(0.5 * (before - after), bend, out=np.zeros_like(bend), where=curved)
    raised = np.minimum(1.0, peak - 0.25 * (before - after) * fraction)
    heights: Array = np.where(curved, raised, curves[rows, best])
    return heights


@kernel
def _faded(values: Bytes, fade: Floats, length: int) -> tuple[Floats, Array]:
    """Images (K, c, h, w) without their rows' means, faded out, with zeros up to ``length``; energies (K, w + 1)."""
    count, channels, height, width = values.shape
    faded = np.zeros((count, channels, height, length), np.float32)
    energy = np.zeros((count, width + 1))
    for k in range(count):
        for c in range(channels):
            for y in range(height):
                source, target = values[k, c, y], faded[k, c, y]
                total = 0
                for x in range(width):
                    total += source[x]
                mean = np.float32(total / width)
                for x in range(width):
                    value = (np.float32(source[x]) - mean) * fade[x]
                    target[x] = value
                    energy[k, x + 1] += value * value
        for x in range(width):
            energy[k, x + 1] += energy[k, x]
    return faded, energy


@kernel
def _products(real: Floats, imaginary: Floats, stored: Floats, offsets: int) -> NDArray[np.complex64]:
    """(K, 2 offsets + 1, f): the new image's transform (c, h, f) times the conjugate of each stored one's.

    The stored ones (K, c, h, 2 f) hold real and imaginary parts by turns; all are summed over channels and rows, with
    the new one's rows moved by each vertical offset.
    """
    count, channels, height, doubled = stored.shape
    size = doubled // 2
    products = np.zeros((count, 2 * offsets + 1, size), np.complex64)
    sums = np.empty((2 * offsets + 1, 2, size), np.float32)
    theirs = np.empty((2, size), np.float32)
    for k in range(count):
        sums[:] = 0.0
        for c in range(channels):
            for y in range(height):
                line = stored[k, c, y]
                for f in range(size):
                    theirs[0, f] = line[2 * f]
                    theirs[1, f] = line[2 * f + 1]
                for o in range(max(-offsets, -y), min(offsets, height - 1 - y) + 1):
                    _add(real[c, y + o], imaginary[c, y + o], theirs[0], theirs[1], sums[o + offsets])
        for o in range(2 * offsets + 1):
            for f in range(size):
                products[k, o, f] = complex(sums[o, 0, f], sums[o, 1, f])
    return products


@kernel
def _add(a: Floats, b: Floats, c: Floats, d: Floats, sums: Floats) -> None:
    """Adds ``(a + ib)(c - id)`` to sums (2, f)."""
    first, second = sums[0], sums[1]
    for f in range(len(a)):
        first[f] += a[f] * c[f] + b[f] * d[f]
        second[f] += b[f] * c[f] - a[f] * d[f]
