"""A simulated world for the tests: textured planes, scanned exactly from any pose, at rest or in motion."""

from __future__ import annotations

import cv2
import numpy as np

from common import geometry
from common.lidar import LidarScan, organised_scan

BEAMS, COLUMNS = 64, 1024
ELEVATIONS = np.linspace(0.26, -0.42, BEAMS)
AZIMUTHS = np.pi - (np.arange(COLUMNS) + 0.5) / COLUMNS * 2.0 * np.pi
OFFSETS = (np.arange(COLUMNS) + 1.0) / COLUMNS * 0.1 - 0.1
_SIZE, _CELL = 1024, 0.08


def _texture(seed):
    rng = np.random.default_rng(seed)
    total = np.zeros((_SIZE, _SIZE), np.float32)
    for cell, weight in ((4, 1.0), (10, 1.5), (30, 1.0)):
        small = rng.normal(size=(_SIZE // cell + 2, _SIZE // cell + 2)).astype(np.float32)
        total += weight * cv2.resize(small, (_SIZE, _SIZE), interpolation=cv2.INTER_CUBIC)
    return cv2.normalize(total, None, 0.1, 0.9, cv2.NORM_MINMAX)


def _wall(x, y, yaw, half, height):
    along = np.array([np.cos(yaw), np.sin(yaw), 0.0])
    return np.array([x, y, 0.0]), along, np.array([0.0, 0.0, 1.0]), (-half, half, -3.0, height)


# Each plane: a point, two axes and the bounds along them, metres; the ground lies 1.7 m below the origin.
_PLANES = [
    (np.array([0.0, 0.0, -1.7]), np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0]), (-60, 60, -60, 60)),
    _wall(0.0, 9.0, 0.0, 40.0, 6.0),
    _wall(0.0, -7.0, 0.05, 40.0, 5.0),
    _wall(24.0, 0.0, 1.5, 12.0, 7.0),
    _wall(-18.0, 0.0, 1.6, 12.0, 7.0),
    _wall(6.0, 5.0, 0.7, 1.5, 1.0),
    _wall(9.0, -4.0, -0.5, 1.5, 0.8),
    _wall(-5.0, 4.0, 2.2, 1.5, 1.2),
    _wall(-8.0, -4.5, 0.3, 2.0, 0.9),
]
_TEXTURES = [_texture(seed) for seed in range(len(_PLANES))]


def _directions():
    e, a = np.meshgrid(ELEVATIONS, AZIMUTHS, indexing="ij")
    return np.stack([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)], -1)


def cast(T_world_lidar):
    """Ranges and reflected light, (H, W) each, from poses (4, 4), or (W, 4, 4) one for each column."""
    T = np.broadcast_to(T_world_lidar, (COLUMNS, 4, 4))
    rays = np.einsum("wij,hwj->hwi", T[:, :3, :3], _directions())
    origins = T[:, :3, 3]
    nearest, light = np.full(rays.shape[:2], np.inf), np.zeros(rays.shape[:2])
    for (point, a, b, bounds), texture in zip(_PLANES, _TEXTURES, strict=True):
        normal = np.cross(a, b)
        with np.errstate(divide="ignore", invalid="ignore"):
            distance = ((point - origins) @ normal)[None] / (rays @ normal)
            hit = origins[None] + distance[..., None] * rays - point
        x, y = hit @ a, hit @ b
        seen = (distance > 0.1) & (distance < nearest)
        seen &= (x >= bounds[0]) & (x <= bounds[1]) & (y >= bounds[2]) & (y <= bounds[3])
        places = [np.nan_to_num(c / _CELL + _SIZE / 2).astype(np.float32) % (_SIZE - 1) for c in (x, y)]
        colours = cv2.remap(texture, *places, cv2.INTER_LINEAR)
        nearest[seen], light[seen] = distance[seen], colours[seen]
    ranges = np.where(np.isfinite(nearest) & (nearest < 80.0), nearest, 0.0)
    return ranges, np.divide(light, ranges, out=np.zeros_like(light), where=ranges > 0.0)


def scan(T_world_lidar=None, *, twist=None, seed=0, noise=0.02, stamp=0, gains=None):
    """A scan whose stamp is the end of the turn, at ``T_world_lidar``; ``twist`` is the lidar's motion meanwhile.

    ``gains`` (H,) are the beams' own, which a real lidar has.
    """
    rng = np.random.default_rng(seed)
    T = np.eye(4) if T_world_lidar is None else T_world_lidar
    if twist is not None:
        T = T @ geometry.exp(OFFSETS[:, None] * np.asarray(twist))
    ranges, light = cast(T)
    ranges = np.where(ranges > 0.0, ranges + noise * rng.normal(size=ranges.shape), 0.0)
    light = 1000.0 * light * (1.0 + 0.03 * rng.normal(size=light.shape))
    if gains is not None:
        light *= gains[:, None]
    return organised_scan(
        stamp, ranges, np.maximum(light, 0.0), ELEVATIONS, AZIMUTHS, None if twist is None else OFFSETS
    )


def as_kitti(organised):
    """The same scan as KITTI's files have it: points alone, one beam's turn after the other, no gaps."""
    points = organised.points.reshape(-1, 3)
    returned = (points != 0.0).any(axis=-1)
    return LidarScan(organised.stamp_ns, points[returned], organised.intensity.ravel()[returned])
