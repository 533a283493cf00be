"""The spinning lidar: what one turn of it measures."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True)
class LidarScan:
    """One turn of a spinning lidar, organised (a row for each beam) or not.

    ``(...)`` stands for ``(N,)`` or, organised, for ``(H, W)``: rows are beams in any order, columns follow the turn.

    Attributes:
        stamp_ns: nanoseconds, the instant in whose frame the points are, or that ``offsets`` count from.
        points: (..., 3) float32, metres in the lidar's frame (x forward, y left, z up); zero or not finite where
            nothing came back.
        intensity: (...) float32, of the light that came back, in any unit but not negative.
        rings: (N,) integers, the beam of each point; None where it is not known, and where the scan is organised.
        offsets: (...) float32, seconds from the stamp at which each point was measured; None where all points are as
            seen at the stamp, either at once or already corrected for the motion.
        reflectivity: whether the intensity is already corrected for the range.
    """

    stamp_ns: int
    points: NDArray[np.float32]
    intensity: NDArray[np.float32]
    rings: NDArray[Any] | None = None
    offsets: NDArray[np.float32] | None = None
    reflectivity: bool = False


def organised_scan(
    stamp_ns: int,
    ranges: NDArray[Any],
    intensities: NDArray[Any],
    elevations: NDArray[Any],
    azimuths: NDArray[Any],
    offsets: NDArray[Any] | None = None,
) -> LidarScan:
    """The scan of ``ranges`` (H, W), metres, 0 where nothing came back, and ``intensities`` (H, W).

    ``elevations`` (H,) or (H, W) and ``azimuths`` (W,) or (H, W) are the beams' directions in the lidar's frame,
    radians; ``offsets`` (W,) the columns' seconds from the stamp.
    """
    elevation = elevations if elevations.ndim == 2 else elevations[:, None]
    azimuth = azimuths if azimuths.ndim == 2 else azimuths[None, :]
    ground = ranges * np.cos(elevation)
    points = np.stack(
        [ground * np.cos(azimuth), ground * np.sin(azimuth), ranges * np.sin(elevation) * np.ones_like(azimuth)],
        axis=-1,
    )
    return LidarScan(
        stamp_ns=stamp_ns,
        points=points.astype(np.float32),
        intensity=intensities.astype(np.float32),
        offsets=None if offsets is None else np.broadcast_to(offsets, ranges.shape).astype(np.float32),
    )
