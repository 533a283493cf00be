"""Everything that can be set in detection, description and matching, with its unit."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

from pydantic import Field


@dataclass(frozen=True, slots=True)
class SurfSettings:
    """SURF.

    Attributes:
        hessian_threshold: least response, square grey levels: see :class:`SurfFeatures`.
        octaves: most octaves of filter sizes; those whose filters exceed the image are left out.
        layers: filters of an octave; the first and the last only bound the scales in which maxima are found.
        max_features: most features of an image.
        cell: side of the square cells over which the features are spread, pixels; None: the strongest, wherever.
        margin: least distance of a feature from the image's edge, as a multiple of its scale. The default is half the
            side of the filter that found it.
        upright: features have no orientation of their own: for a sensor that does not roll.
        ratio: the nearest descriptor's distance must be below this part of the second nearest's.
        max_distance: largest distance of two descriptors that match; of unrelated ones it is about 1.
        device: where features are detected and described: ``cpu``, compiled; ``gpu``, on arrays, by CuPy or PyTorch.
    """

    hessian_threshold: Annotated[float, Field(gt=0)] = 30.0
    octaves: Annotated[int, Field(ge=1, le=5)] = 4
    layers: Annotated[int, Field(ge=3, le=5)] = 4
    max_features: Annotated[int, Field(ge=1)] = 1000
    cell: Annotated[int, Field(ge=1)] | None = None
    margin: Annotated[float, Field(ge=0)] = 3.75
    upright: bool = False
    ratio: Annotated[float, Field(gt=0, le=1)] = 0.8
    max_distance: Annotated[float, Field(gt=0, le=2)] = 0.7
    device: Literal["cpu", "gpu"] = "cpu"
