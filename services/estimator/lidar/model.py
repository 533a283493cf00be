"""The measurement model of a spinning lidar: azimuth, elevation and range of a point.

``z = (azimuth, elevation, range)`` with ``azimuth = atan2(y, x)``, ``elevation = atan2(z, hypot(x, y))``, radians and
metres, in the lidar's frame (x forward, y left, z up).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from common.compiled import kernel

Array = NDArray[np.float64]


def to_points(measurements: ArrayLike) -> Array:
    """Points (..., 3) of measurements (..., 3)."""
    m = np.asarray(measurements, dtype=np.float64)
    azimuth, elevation, distance = m[..., 0], m[..., 1], m[..., 2]
    ground = distance * np.cos(elevation)
    return np.stack([ground * np.cos(azimuth), ground * np.sin(azimuth), distance * np.sin(elevation)], axis=-1)


def to_measurements(points: ArrayLike) -> Array:
    """Measurements (..., 3) of points (..., 3), none of which is the lidar itself."""
    p = np.asarray(points, dtype=np.float64)
    ground = np.hypot(p[..., 0], p[..., 1])
    return np.stack(
        [np.arctan2(p[..., 1], p[..., 0]), np.arctan2(p[..., 2], ground), np.hypot(ground, p[..., 2])], axis=-1
    )


def point_jacobians(measurements: ArrayLike) -> Array:
    """Derivatives (..., 3, 3) of :func:`to_points` by the measurement."""
    m = np.asarray(measurements, dtype=np.float64)
    ca, sa, ce, se = np.cos(m[..., 0]), np.sin(m[..., 0]), np.cos(m[..., 1]), np.sin(m[..., 1])
    r = m[..., 2]
    out = np.zeros((*r.shape, 3, 3))
    out[..., 0, 0], out[..., 0, 1], out[..., 0, 2] = -r * ce * sa, -r * se * ca, ce * ca
    out[..., 1, 0], out[..., 1, 1], out[..., 1, 2] = r * ce * ca, -r * se * sa, ce * sa
    out[..., 2, 1], out[..., 2, 2] = r * ce, se
    return out


@kernel
def predict(point: Array, T: Array, moved: Array, out: Array) -> bool:
    """Write the point (3,) that ``T`` moves into ``moved``, its measurement into ``out``; False at the lidar itself."""
    for i in range(3):
        moved[i] = T[i, 0] * point[0] + T[i, 1] * point[1] + T[i, 2] * point[2] + T[i, 3]
    ground = np.sqrt(moved[0] * moved[0] + moved[1] * moved[1])
    out[0], out[1] = np.arctan2(moved[1], moved[0]), np.arctan2(moved[2], ground)
    out[2] = np.sqrt(ground * ground + moved[2] * moved[2])
    return bool(ground > 1e-3)


@kernel
def derivatives(moved: Array, T: Array, by_pose: Array, by_landmark: Array) -> None:
    """Write the derivatives of :func:`predict` by a left perturbation of ``T`` (3, 6) and by the point (3, 3)."""
    x, y, z = moved[0], moved[1], moved[2]
    ground2 = x * x + y * y
    ground, distance2 = np.sqrt(ground2), ground2 + z * z
    distance = np.sqrt(distance2)
    by_pose[0, 0], by_pose[0, 1], by_pose[0, 2] = -y / ground2, x / ground2, 0.0
    by_pose[1, 0], by_pose[1, 1] = -x * z / (distance2 * ground), -y * z / (distance2 * ground)
    by_pose[1, 2] = ground / distance2
    by_pose[2, 0], by_pose[2, 1], by_pose[2, 2] = x / distance, y / distance, z / distance
    for i in range(3):
        a, b, c = by_pose[i, 0], by_pose[i, 1], by_pose[i, 2]
        # J (-[q]x) = q x J, row by row.
        by_pose[i, 3], by_pose[i, 4], by_pose[i, 5] = y * c - z * b, z * a - x * c, x * b - y * a
        for j in range(3):
            by_landmark[i, j] = a * T[0, j] + b * T[1, j] + c * T[2, j]


@kernel
def difference(measured: Array, predicted: Array, out: Array) -> None:
    """Write ``measured - predicted``, the azimuth's taken the short way round."""
    turn = measured[0] - predicted[0]
    if turn > np.pi:
        turn -= 2.0 * np.pi
    elif turn < -np.pi:
        turn += 2.0 * np.pi
    out[0], out[1], out[2] = turn, measured[1] - predicted[1], measured[2] - predicted[2]
