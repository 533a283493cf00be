"""What the C library does with freed memory: glibc keeps more and more of it, in pieces between what is still in use.

Another C library has no such calls, and is left as it is.
"""

from __future__ import annotations

import contextlib
import ctypes

_TRIM_THRESHOLD, _MMAP_THRESHOLD = -1, -3
"""glibc's names of two of its settings (malloc.h)."""


def give_back_freed() -> None:
    """Gives whole pages that are free back to the system, wherever they lie; takes a few milliseconds at most.

    A cache of submaps whose size is bounded grows by a tenth in an hour without it.
    """
    with contextlib.suppress(AttributeError, OSError):
        ctypes.CDLL(None).malloc_trim(0)


def keep_freed() -> None:
    """Keeps what is freed: fetching the pages of each frame's copies anew costs as much as writing it to a file."""
    with contextlib.suppress(AttributeError, OSError):
        library = ctypes.CDLL(None)
        library.mallopt(_MMAP_THRESHOLD, 32 << 20)
        library.mallopt(_TRIM_THRESHOLD, 256 << 20)
