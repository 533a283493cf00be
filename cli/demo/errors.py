"""How far a repeated path is from the taught one."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from common import geometry
from common.geometry import Array

_NEAR_M = 3.0


@dataclass(frozen=True, slots=True)
class PathErrors:
    """Errors of M repeated poses against the taught path.

    Attributes:
        arclength: (M,) metres along the taught path of the nearest point.
        lateral: (M,) metres, positive where the robot is left of the taught path.
        heading: (M,) radians, positive where it points further left.
    """

    arclength: Array
    lateral: Array
    heading: Array

    def after(self, arclength: float) -> PathErrors:
        """The errors from a place of the taught path on."""
        keep = self.arclength >= arclength
        return PathErrors(self.arclength[keep], self.lateral[keep], self.heading[keep])


def path_errors(taught: Array, repeated: Array) -> PathErrors:
    """Errors of repeated poses (M, 4, 4) against taught ones (N, 4, 4), both in driving order in one world.

    The first pose's nearest point is sought everywhere on the taught polyline, and the next ones' near the last one's,
    since a route may cross itself.
    """
    taught = _without_standstill(taught)
    xy, yaw = taught[:, :2, 3], np.unwrap(geometry.yaw_of(taught))
    steps = np.diff(xy, axis=0)
    lengths = np.linalg.norm(steps, axis=1)
    start = np.concatenate([[0.0], np.cumsum(lengths)])
    out = np.empty((len(repeated), 3))
    near = np.arange(len(steps))
    for i, T in enumerate(repeated):
        k, t, lateral = _nearest(xy[near], steps[near], lengths[near], T[:2, 3])
        k = near[k]
        here = start[k] + t * lengths[k]
        near = np.flatnonzero((start[1:] > here - _NEAR_M) & (start[:-1] < here + _NEAR_M))
        heading = geometry.yaw_of(T) - (yaw[k] + t * (yaw[k + 1] - yaw[k]))
        out[i] = here, lateral, np.arctan2(np.sin(heading), np.cos(heading))
    return PathErrors(*out.T)


def settling_distance(errors: PathErrors, within: float = 0.05) -> float:
    """Metres along the path until the lateral error first comes within a bound; infinite if it never does."""
    inside = np.flatnonzero(np.abs(errors.lateral) <= within)
    return float(errors.arclength[inside[0]]) if len(inside) else float("inf")


def _nearest(start: Array, step: Array, length: Array, point: Array) -> tuple[int, float, float]:
    """Index of the nearest segment, the part of it that lies behind, and the signed lateral distance."""
    offset = point - start
    t = np.clip(np.einsum("ij,ij->i", offset, step) / length**2, 0.0, 1.0)
    gap = offset - t[:, None] * step
    k = int(np.argmin(np.einsum("ij,ij->i", gap, gap)))
    lateral = (step[k, 0] * offset[k, 1] - step[k, 1] * offset[k, 0]) / length[k]
    return k, float(t[k]), float(lateral)


def _without_standstill(poses: Array, least: float = 0.02) -> Array:
    """The poses that are at least ``least`` metres apart."""
    kept: list[NDArray[np.float64]] = [poses[0]]
    for T in poses[1:]:
        if np.linalg.norm(T[:2, 3] - kept[-1][:2, 3]) >= least:
            kept.append(T)
    return np.array(kept)
