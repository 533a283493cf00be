"""What a recording is to the offline runs."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from common.camera import StereoCamera
from common.lidar import LidarScan

OnFrame = Callable[[], None]
"""Called after every frame, to show progress."""


class Pair(Protocol):
    """A rectified stereo pair: images (H, W) grey or (H, W, 3) RGB, uint8, and its stamp in nanoseconds."""

    @property
    def stamp_ns(self) -> int: ...  # noqa: D102 - said above
    @property
    def left(self) -> NDArray[np.uint8]: ...  # noqa: D102
    @property
    def right(self) -> NDArray[np.uint8]: ...  # noqa: D102


class Recording(Protocol):
    """A drive: its camera, its pairs in order, and the true poses ``T_world_left`` (N, 4, 4) where they are known."""

    @property
    def camera(self) -> StereoCamera: ...  # noqa: D102 - said above
    @property
    def poses_truth(self) -> NDArray[np.float64] | None: ...  # noqa: D102
    def __iter__(self) -> Iterator[Any]:
        """The pairs, each a :class:`Pair`."""
        ...


class LidarRecording(Protocol):
    """A drive with a lidar: its scans in order."""

    @property
    def name(self) -> str: ...  # noqa: D102 - said above
    def __iter__(self) -> Iterator[LidarScan]:
        """The scans."""
        ...
