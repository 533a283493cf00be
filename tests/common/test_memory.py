"""What a long-lived process takes of the machine's memory."""

import sys

import numpy as np
import psutil
import pytest

from common.memory import give_back_freed

SIZE = 60_000
"""Smaller than what the C library fetches from the system, and gives back to it, by itself."""


@pytest.mark.skipif(sys.platform != "linux", reason="glibc's own call")
def test_what_is_freed_between_what_is_in_use_is_given_back():
    process = psutil.Process()
    arrays = [np.ones(SIZE, np.uint8) for _ in range(3000)]
    kept = arrays[::10]
    full = process.memory_info().rss
    del arrays
    give_back_freed()
    assert full - process.memory_info().rss > 0.7 * 0.9 * 3000 * SIZE
    assert all(int(array.sum()) == SIZE for array in kept)
