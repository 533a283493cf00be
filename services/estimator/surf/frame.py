"""An image made ready: checked, with margins, and with the octaves that it has."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from services.estimator.surf import descriptor
from services.estimator.surf.features import SurfError
from services.estimator.surf.integral import extended
from services.estimator.surf.octaves import Octave, largest_scale, octaves_of, reach_of
from services.estimator.surf.settings import SurfSettings


@dataclass(frozen=True, slots=True)
class Frame:
    """What detection and description work on, whichever device they run on.

    Attributes:
        settings: theirs.
        shape: (H, W) of the image.
        wide: (H + 2 pad_y, W + 2 pad_x) uint8, the image with its margins.
        pad_x, pad_y: the margins, pixels.
        octaves: those that fit; none for a tiny image.
        mask: (H, W), zero where no feature may be; None: anywhere.
        wrap: whether the left and the right edge are neighbours.
    """

    settings: SurfSettings
    shape: tuple[int, int]
    wide: NDArray[np.uint8]
    pad_x: int
    pad_y: int
    octaves: list[Octave]
    mask: NDArray[np.uint8] | None
    wrap: bool


def prepare(image: NDArray[np.uint8], settings: SurfSettings, mask: NDArray[Any] | None, *, wrap: bool) -> Frame:
    """Check an image (H, W) and its mask, and give the image its margins.

    Raises:
        SurfError: the image or the mask has another shape or type, or the image is too large.
    """
    grey = np.asarray(image)
    if grey.ndim != 2 or grey.dtype != np.uint8:
        raise SurfError(f"the image must be grey, (H, W) uint8, not {grey.dtype}{grey.shape}")
    shape = (grey.shape[0], grey.shape[1])
    octaves = octaves_of(*shape, settings.octaves, settings.layers)
    allowed = None if mask is None else _checked_mask(np.asarray(mask), shape)
    if not octaves:
        return Frame(settings, shape, grey, 0, 0, octaves, allowed, wrap)
    pad = reach_of(octaves)
    # A panorama goes on beyond what a descriptor sees; elsewhere its outermost pixels are extrapolated.
    pad_x = max(pad, math.ceil(descriptor.REACH * largest_scale(octaves))) if wrap else pad
    wide = extended(np.ascontiguousarray(grey), pad_x, pad, wrap=wrap)
    return Frame(settings, shape, wide, pad_x, pad, octaves, allowed, wrap)


def _checked_mask(mask: NDArray[Any], shape: tuple[int, int]) -> NDArray[np.uint8]:
    if mask.shape != shape or mask.dtype not in {np.dtype(np.uint8), np.dtype(np.bool_)}:
        raise SurfError(f"the mask must be uint8{shape}, as the image, not {mask.dtype}{mask.shape}")
    return np.ascontiguousarray(mask).view(np.uint8)
