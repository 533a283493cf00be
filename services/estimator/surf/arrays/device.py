"""Which library's arrays are computed with, and where they are."""

from __future__ import annotations

import importlib
import importlib.util
from collections.abc import Callable
from dataclasses import dataclass
from types import ModuleType
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from services.estimator.surf.features import SurfError

Array: TypeAlias = Any
"""An array of whichever library."""


@dataclass(frozen=True, slots=True)
class Device:
    """A library of arrays and a place that it computes at.

    Attributes:
        xp: the library, with the functions of the array API standard, 2023.12 or later.
        place: the library's own name of the place.
        download: gives an array back as NumPy's.
    """

    xp: ModuleType
    place: object
    download: Callable[[Array], NDArray[Any]]

    def upload(self, array: NDArray[Any]) -> Array:
        """NumPy's array at the place."""
        return self.xp.asarray(array, device=self.place)


def numpy_device() -> Device:
    """NumPy on the processor: for tests."""
    return Device(np, "cpu", np.asarray)


def find_gpu() -> Device:
    """A GPU by CuPy, else by PyTorch.

    Raises:
        SurfError: neither is installed, or neither finds a GPU.
    """
    for library, open_ in (("cupy", _cupy), ("torch", _torch)):
        if importlib.util.find_spec(library) and importlib.util.find_spec("array_api_compat"):
            found = open_(importlib.import_module(f"array_api_compat.{library}"))
            if found is not None:
                return found
    raise SurfError(
        "no GPU for SURF: neither CuPy nor PyTorch finds one, or array-api-compat is missing; "
        "set its device to 'cpu', which needs none"
    )


def _cupy(xp: ModuleType) -> Device | None:
    if not xp.cuda.is_available():
        return None
    return Device(xp, xp.cuda.Device(0), xp.asnumpy)


def _torch(xp: ModuleType) -> Device | None:
    if not xp.cuda.is_available():
        return None
    return Device(xp, xp.device("cuda"), lambda array: np.asarray(array.cpu()))
