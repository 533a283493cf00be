"""What a vertex keeps for bearing-only localization: the image's representation, and the actions that led to it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from common.errors import ImageError
from common.geometry import Array
from common.registration import Described
from services.estimator.bearing.actions import COLUMNS
from services.estimator.bearing.comparison import StoredImage

_ACTIONS = "actions"
_IMAGE = "image/"


@dataclass(frozen=True, slots=True)
class BearingSubmap:
    """Images of one vertex or several, each with its place ``T_first_vertex`` (4, 4) in the first one's frame."""

    members: tuple[tuple[StoredImage, Array], ...]

    @property
    def first(self) -> StoredImage:
        """The image of the vertex in whose frame the submap is."""
        return self.members[0][0]


def to_arrays(described: Described, actions: NDArray[np.float32]) -> dict[str, NDArray[Any]]:
    """A vertex's image and actions as a keyframe's arrays."""
    return {_ACTIONS: actions} | {f"{_IMAGE}{name}": array for name, array in described.to_arrays().items()}


def from_arrays(arrays: Mapping[str, NDArray[Any]]) -> tuple[Described, NDArray[np.float32]]:
    """Inverse of :func:`to_arrays`.

    Raises:
        ImageError: the arrays are not those of a bearing keyframe.
    """
    actions = arrays.get(_ACTIONS)
    if actions is None or actions.ndim != 2 or actions.shape[1] != COLUMNS:
        raise ImageError("the keyframe holds no actions: it is none of a bearing map")
    image = {name.removeprefix(_IMAGE): array for name, array in arrays.items() if name.startswith(_IMAGE)}
    return Described.from_arrays(image), actions.astype(np.float32)
