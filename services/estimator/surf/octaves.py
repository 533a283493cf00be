"""The sizes of the filters: octaves of scale, and their layers.

The paper's filters have lobes of an odd number of pixels, so that their sizes 9, 15, 21, 27 are far apart at the finest
scales. Here a lobe may also be even: its outer edges then lie in the middle of pixels, where the integral image is the
mean of two of its entries. Octaves follow each other without overlap, and maxima are found from filter 9 on, a smaller
filter bounding them from below.
"""

from __future__ import annotations

from typing import NamedTuple

SIGMA_PER_SIZE = 1.2 / 9.0
"""The filter of 9 pixels stands for a Gaussian of standard deviation 1.2 (section 3.2 of the paper)."""


class Octave(NamedTuple):
    """Filters that are compared with each other, and the grid on which they are evaluated.

    Attributes:
        sizes: side lengths of the filters, pixels, thrice their lobes'.
        step: distance of the grid's points, pixels.
    """

    sizes: tuple[int, ...]
    step: int


def octaves_of(height: int, width: int, octaves: int, layers: int) -> list[Octave]:
    """The octaves of which at least one filter between two others fits into an image.

    The lobes of the first octave are 3 pixels times powers of the ``layers - 2``-th root of 2, rounded: 2, 3, 4 and 6
    for 4 layers. All doubles with each octave.
    """
    lobes = [round(3.0 * 2.0 ** ((layer - 1) / (layers - 2))) for layer in range(layers)]
    wanted = [Octave(tuple(3 * lobe * 2**octave for lobe in lobes), 2**octave) for octave in range(octaves)]
    return [octave for octave in wanted if octave.sizes[1] <= min(height, width)]


def reach_of(octaves: list[Octave]) -> int:
    """Pixels beyond the image's edge that the filters see, from the grid's points one step outside too."""
    return max(octave.sizes[-1] // 2 + octave.step + 2 for octave in octaves)


def largest_scale(octaves: list[Octave]) -> float:
    """No feature has a larger scale, pixels."""
    return SIGMA_PER_SIZE * octaves[-1].sizes[-1]
