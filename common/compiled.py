"""The decorator of the compiled loops: numba's, typed, with the options that all of them share."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, ParamSpec, TypeVar, cast

import numba

P = ParamSpec("P")
R = TypeVar("R")


def kernel(function: Callable[P, R]) -> Callable[P, R]:
    """Compile ``function`` at its first call and keep the machine code on disk.

    The lock of the interpreter is released, so that frames of two streams are worked on side by side. Floating-point
    arithmetic stays exact: a NaN must be seen as one.
    """
    compile_: Callable[[Callable[..., Any]], Any] = numba.njit(cache=True, nogil=True, error_model="numpy")
    return cast("Callable[P, R]", compile_(function))
