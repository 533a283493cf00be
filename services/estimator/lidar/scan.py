"""Whether a scan can be worked with: what is wrong with it, in one sentence."""

from __future__ import annotations

import numpy as np

from common.lidar import LidarScan
from services.estimator.lidar.beams import MAX_BEAMS, ScanError

_MAX_POINTS = 4_000_000
_LONGEST = 2.0
"""Seconds that a point's offset from the stamp may have."""


def check(scan: LidarScan) -> None:
    """Refuses a scan that no spinning lidar with intensity delivers.

    Points that are not finite are points that did not come back.

    Raises:
        ScanError: a shape is wrong, nothing came back, or there is no intensity.
    """
    points, intensity = scan.points, scan.intensity
    if points.ndim not in (2, 3) or points.shape[-1] != 3 or not 0 < points.size <= 3 * _MAX_POINTS:
        raise ScanError(f"a scan has points (N, 3) or (H, W, 3), not {points.shape}")
    if intensity.shape != points.shape[:-1]:
        raise ScanError(
            f"the scan has {int(np.prod(points.shape[:-1]))} points and {intensity.size} intensities: each needs one"
        )
    # A sum is not finite where one of its parts is not.
    returned = np.isfinite(points.sum(axis=-1)) & (points[..., 0] != 0.0)
    if not returned.any():
        raise ScanError("the scan is empty: no point came back")
    seen = intensity[returned]
    if not np.isfinite(seen).mean() > 0.9:
        raise ScanError("the scan's intensities are not numbers")
    seen = seen[np.isfinite(seen)]
    if seen.min() < 0.0:
        raise ScanError("the scan has negative intensities")
    if not seen.max() > seen.min():
        raise ScanError(f"the scan has no intensity: it is {seen.max():g} at every point")
    _check_rings(scan)
    if scan.offsets is not None:
        if scan.offsets.shape != intensity.shape:
            raise ScanError(f"the scan has offsets {scan.offsets.shape} for points {points.shape[:-1]}")
        if not np.abs(scan.offsets).max() <= _LONGEST:
            raise ScanError(f"the scan has points measured more than {_LONGEST:g} s from its stamp")


def _check_rings(scan: LidarScan) -> None:
    if scan.points.ndim == 3:
        if scan.points.shape[0] > MAX_BEAMS:
            raise ScanError(f"the scan has {scan.points.shape[0]} beams: at most {MAX_BEAMS} are taken")
        return
    if scan.rings is None:
        return
    if scan.rings.shape != scan.intensity.shape or scan.rings.dtype.kind not in "iu":
        raise ScanError("the scan's rings are not one whole number for each point")
    if scan.rings.min() < 0 or scan.rings.max() >= MAX_BEAMS:
        raise ScanError(f"the scan's rings are not between 0 and {MAX_BEAMS - 1}")
