"""The similarity of two representations over all horizontal shifts: equation 3.4 of the thesis at each of them.

``L(d) = sum_cjk R(I1)[c, j, k] R(I2)[c, j, k - d]`` for all d at once, by FFT along the rows. Beyond the thesis:

* Both images fade out towards their sides. Driving a little ahead of or behind the place of the stored image spreads
  the scene about the middle, so what stands in the middle tells the direction, and what stands at the side does not.
* The sum is divided by the energy of the two overlapping parts, so that large shifts are not at a disadvantage and the
  similarity lies in [-1, 1].
* A camera that pitches moves the rows, so of a few vertical offsets the best counts, at each shift.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from common.registration.representation import Described

Spectrum = NDArray[np.complex64]
Curve = NDArray[np.float64]

VERTICAL_REACH = 0.05
"""Largest vertical offset, in widths of the image: 2 to 4 degrees of pitch with the usual lenses."""

_FADE = 0.5
"""Exponent of the half sine that fades an image out; the product of two is a half sine."""


@dataclass(frozen=True, slots=True)
class Prepared:
    """A representation that is ready to be correlated with others.

    Attributes:
        described: the representation.
        spectrum: (c, h, w + 1), Fourier transform along the rows, faded and padded with as many zeros.
        energy: (w + 1,): entry k is the energy of the first k columns, faded.
    """

    described: Described
    spectrum: Spectrum
    energy: Curve


def prepare(described: Described) -> Prepared:
    """Fades a representation out towards its sides, without its rows' means, and transforms it."""
    width = described.values.shape[2]
    centred = described.values - described.values.mean(axis=2, keepdims=True)
    faded = (centred * fading(width)).astype(np.float32)
    columns = np.einsum("chw,chw->w", faded, faded, dtype=np.float64)
    spectrum = np.fft.rfft(faded, 2 * width, axis=2).astype(np.complex64)
    return Prepared(described, spectrum, np.concatenate([[0.0], np.cumsum(columns)]))


@lru_cache(maxsize=8)
def fading(width: int) -> Curve:
    """(w,) what each column of an image counts: little at its sides."""
    fade: Curve = np.sin(np.pi * (np.arange(width) + 0.5) / width) ** _FADE
    return fade


def similarity(live: Prepared, stored: Prepared, reach: int) -> Curve:
    """Similarity (2 reach + 1,) at shifts of -reach to reach columns, positive to the right in the live image.

    The two grids have the same channels and columns; a surplus row of one is left out. An image without any structure
    is similar to nothing: all zero.
    """
    width = live.described.values.shape[2]
    shifts = np.arange(-reach, reach + 1)
    product = np.full(len(shifts), -np.inf)
    rows = min(live.spectrum.shape[1], stored.spectrum.shape[1])
    offsets = min(int(VERTICAL_REACH / live.described.cell_height), rows - 1)
    conjugate = stored.spectrum[:, :rows].conj()
    for offset in range(-offsets, offsets + 1):
        a = live.spectrum[:, max(0, offset) : rows + min(0, offset)]
        b = conjugate[:, max(0, -offset) : rows + min(0, -offset)]
        product = np.maximum(product, np.fft.irfft(np.einsum("chf,chf->f", a, b), 2 * width)[shifts])
    overlap = _overlap_energy(live.energy, shifts) * _overlap_energy(stored.energy, -shifts)
    curve: Curve = np.divide(product, np.sqrt(overlap), out=np.zeros_like(product), where=overlap > 0.0)
    return curve


def _overlap_energy(energy: Curve, shifts: NDArray[np.int64]) -> Curve:
    """Energy of the columns that have a partner, of an image whose scene is ``shifts`` columns further right."""
    last = len(energy) - 1
    part: Curve = energy[np.minimum(last, last + shifts)] - energy[np.maximum(0, shifts)]
    return part
