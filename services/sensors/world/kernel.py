"""How the renderer's innermost functions are compiled."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, ParamSpec, TypeVar, cast

import numba

P = ParamSpec("P")
R = TypeVar("R")

_OPTIONS: dict[str, Any] = {
    "nogil": True,
    "error_model": "numpy",
    # Liberties that keep infinities and NaN what they are.
    "fastmath": {"contract", "reassoc", "arcp", "nsz"},
    # Nothing is allocated here, so numba's reference counts, counted atomically at each call, would only cost time:
    # about a fifth of a frame's.
    "_nrt": False,
}


def kernel(function: Callable[P, R]) -> Callable[P, R]:
    """Compile a function that allocates nothing at its first call, and keep the machine code on disk.

    It runs without the interpreter's lock.
    """
    return cast("Callable[P, R]", cast("Any", numba.njit)(cache=True, **_OPTIONS)(function))


def inlined(function: Callable[P, R]) -> Callable[P, R]:
    """Compile a function into each of its callers.

    To hand over a dozen arrays by value costs more than many a function's work.
    """
    return cast("Callable[P, R]", cast("Any", numba.njit)(inline="always", **_OPTIONS)(function))
