"""What a scene is drawn from is drawn once: results of slow functions are kept in the user's cache folder.

A result belongs to its arguments and to this package's code: a world whose code has changed is drawn anew.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, TypeVar

import joblib
import platformdirs
import structlog

T = TypeVar("T")

_MOST_BYTES = 1 << 30

log = structlog.get_logger()


def kept(function: Callable[..., T], *arguments: Any, beside: tuple[Any, ...] = ()) -> T:  # noqa: ANN401, whatever it takes
    """``function(*arguments, *beside)``, computed or from the cache.

    The result must follow from ``arguments`` alone; ``beside`` is what has been made of them already.
    """
    try:
        memory = _memory()
        memory.reduce_size(bytes_limit=_MOST_BYTES)
        result: T = memory.cache(_call, ignore=["beside"])(function, _code(), arguments, beside)
    except OSError as error:
        log.warning("the world is not kept for the next start", reason=str(error))
        return function(*arguments, *beside)
    return result


def _call(function: Callable[..., T], _code: str, arguments: tuple[Any, ...], beside: tuple[Any, ...]) -> T:
    return function(*arguments, *beside)


@cache
def _memory() -> joblib.Memory:
    return joblib.Memory(platformdirs.user_cache_dir("retraverse"), verbose=0)


@cache
def _code() -> str:
    """A sum over the files of this package."""
    total = hashlib.sha256()
    for file in sorted(Path(__file__).parent.glob("*.py")):
        total.update(file.read_bytes())
    return total.hexdigest()
