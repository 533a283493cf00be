"""The floating-mean Lomb-Scargle periodogram of unevenly sampled series, by non-uniform FFT.

At each frequency a constant and a sinusoid are fitted to the samples (Zechmeister & Kürster, *A&A* 496, 2009); the
power is the part of the variance that the sinusoid explains, in [0, 1]. The six sums that this takes are non-uniform
Fourier transforms (finufft), so thousands of frequencies of ten thousand samples take milliseconds. The transform's
own magnitude would not do: it is convolved with the transform of the times at which somebody happened to look.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import finufft
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

_ACCURACY = 1e-9
_SINGULAR = 1e-6
"""Determinant below which the samples do not tell a sinusoid from a constant."""
_BATCH = 2_000_000
"""Most complex numbers of one transform's input or output."""


@dataclass(frozen=True, slots=True)
class Grid:
    """M frequencies from ``first``, ``step`` apart, in 1/hour."""

    first: float
    step: float
    count: int

    @classmethod
    def between(cls, lowest: float, highest: float, span: float, oversampling: float) -> Self:
        """Frequencies so dense that a peak of a series of that span, hours, is met ``oversampling`` times."""
        step = 1.0 / (span * oversampling)
        return cls(lowest, step, max(1, int((highest - lowest) / step) + 1))

    @property
    def frequencies(self) -> Array:
        """(M,), 1/hour."""
        frequencies: Array = self.first + self.step * np.arange(self.count, dtype=np.float64)
        return frequencies


class Periodogram:
    """The powers of series with the same times and weights over one grid."""

    def __init__(self, hours: Array, shares: Array, grid: Grid) -> None:
        """``hours`` (N,) lie about zero; ``shares`` (N,) add up to 1."""
        self._hours, self._shares, self.grid = hours, shares, grid
        window = transform(hours, shares[None], grid)[0]
        double = transform(hours, shares[None], Grid(2 * grid.first, 2 * grid.step, grid.count))[0]
        self._c, self._s = window.real, window.imag
        self._cc = 0.5 * (1.0 + double.real) - self._c**2
        self._ss = 0.5 * (1.0 - double.real) - self._s**2
        self._cs = 0.5 * double.imag - self._c * self._s
        determinant = self._cc * self._ss - self._cs**2
        self._inverse = np.divide(1.0, determinant, out=np.zeros(grid.count), where=determinant > _SINGULAR)

    def powers(self, values: Array) -> Array:
        """(B, M) powers of B series of values (B, N)."""
        centred = values - (values @ self._shares)[:, None]
        variance = centred**2 @ self._shares
        batch = max(1, _BATCH // max(len(self._hours), self.grid.count))
        parts = [self._raw(centred[k : k + batch]) for k in range(0, len(values), batch)]
        powers: Array = np.concatenate(parts) / np.maximum(variance, np.finfo(np.float64).tiny)[:, None]
        return np.clip(powers, 0.0, 1.0)

    def power(self, values: Array) -> Array:
        """(M,) powers of one series of values (N,)."""
        powers: Array = self.powers(values[None])[0]
        return powers

    def _raw(self, centred: Array) -> Array:
        sums = transform(self._hours, centred * self._shares, self.grid)
        yc, ys = sums.real, sums.imag
        raw: Array = self._inverse * (self._ss * yc**2 + self._cc * ys**2 - 2.0 * self._cs * yc * ys)
        return raw


def transform(hours: Array, strengths: NDArray[np.generic], grid: Grid) -> Complex:
    """(B, M): ``sum_n strength_n exp(2 pi i f hours_n)`` for strengths (B, N) at a grid's frequencies."""
    middle = grid.count // 2
    phase = 2.0 * np.pi * hours
    shifted = strengths * np.exp(1j * (grid.first + middle * grid.step) * phase)
    x = np.mod(grid.step * phase + np.pi, 2.0 * np.pi) - np.pi
    out: Complex = finufft.nufft1d1(x, shifted, grid.count, isign=1, eps=_ACCURACY, nthreads=1)
    return out.reshape(len(strengths), grid.count)
