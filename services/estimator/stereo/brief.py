"""BRIEF-256 descriptors and their Hamming distance.

M. Calonder et al., *BRIEF: Binary robust independent elementary features*, ECCV 2010: each bit compares two pixels of
the smoothed patch around the feature; the pairs are drawn once from an isotropic Gaussian (the paper's G II).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numba import types
from numba.extending import intrinsic
from numpy.typing import NDArray

from common.compiled import kernel

BYTES = 32
REACH = 15
"""Largest distance of a compared pixel from the feature along an axis, pixels."""


def _pattern() -> NDArray[np.int8]:
    """The 256 pairs (256, 4) ``[x1, y1, x2, y2]``; fixed by the seed, since stored descriptors depend on them."""
    generator = np.random.Generator(np.random.PCG64(20100905))
    pairs = generator.normal(0.0, (2 * REACH + 1) / 5.0, (4096, 4)).round()
    inside = np.abs(pairs).max(axis=1) <= REACH
    distinct = np.abs(pairs[:, :2] - pairs[:, 2:]).max(axis=1) >= 2
    return np.ascontiguousarray(pairs[inside & distinct][: 8 * BYTES], dtype=np.int8)


PATTERN = _pattern()


@kernel
def _describe(smooth: NDArray[np.uint8], places: NDArray[np.int32]) -> NDArray[np.uint8]:
    out = np.zeros((places.shape[0], BYTES), np.uint8)
    for i in range(places.shape[0]):
        x, y = places[i, 0], places[i, 1]
        for byte in range(BYTES):
            bits = 0
            for bit in range(8):
                k = 8 * byte + bit
                first = smooth[y + PATTERN[k, 1], x + PATTERN[k, 0]]
                second = smooth[y + PATTERN[k, 3], x + PATTERN[k, 2]]
                bits |= int(first < second) << bit
            out[i, byte] = bits
    return out


def describe(smooth: NDArray[np.uint8], places: NDArray[np.int32]) -> NDArray[np.uint8]:
    """Descriptors (N, 32) of the places (N, 2) ``[x, y]``, at least :data:`REACH` pixels inside a smoothed image."""
    return _describe(smooth, places)


def _generate_popcount(_context: Any, argument: Any) -> tuple[Any, Callable[..., Any]]:  # noqa: ANN401 - numba's protocol
    def generate(_: Any, builder: Any, __: Any, arguments: Any) -> Any:  # noqa: ANN401 - numba's protocol
        return builder.ctpop(arguments[0])

    return types.uint64(argument), generate


_popcount: Any = intrinsic(_generate_popcount)
"""Number of bits set in a 64-bit integer, by the processor's own instruction."""


@kernel
def hamming(a: NDArray[np.uint64], b: NDArray[np.uint64]) -> int:
    """Number of differing bits of two descriptors, each as 4 words of 64 bits."""
    return int(_popcount(a[0] ^ b[0]) + _popcount(a[1] ^ b[1]) + _popcount(a[2] ^ b[2]) + _popcount(a[3] ^ b[3]))


def as_words(descriptors: NDArray[np.uint8]) -> NDArray[np.uint64]:
    """Descriptors (N, 32) of bytes as (N, 4) words, for :func:`hamming`."""
    return np.ascontiguousarray(descriptors).view(np.uint64)
