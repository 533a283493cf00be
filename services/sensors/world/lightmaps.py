"""How much of the sun and of the sky each surface sees: computed by ray casting, kept in maps.

A sample is a uint32: the low 16 bits the sun's visibility times the cosine of its incidence, the high 16 bits
the part of the sky's light that arrives; 65535 is full.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from common.geometry import Array
from services.sensors.world.cache import kept
from services.sensors.world.geometry import Floats, Geometry, chart_points
from services.sensors.world.rays import RayCaster
from services.sensors.world.scene import GROUND_TEXELS, Scene
from services.sensors.world.settings import SceneSettings
from services.sensors.world.textures import mip_levels, tiled

_OFF_SURFACE = 0.02
"""Where rays start, metres off the surface, so that it does not shadow itself."""
_SKY_RAYS = 24
_SKY_GRID = 256
_BOUNCE = 0.15
"""What a surface gets from directions where it sees no sky, relative to open sky."""
_LEAF_DIFFUSION = 0.4
"""How much of a leaf's light does not depend on its direction: leaves scatter and let light through."""


@dataclass(frozen=True, slots=True)
class LightMaps:
    """The maps for one position of the sun.

    Attributes:
        ground: all mip levels of the ground's square map, level 0 first, in tiles.
        charts: the samples of the things' charts.
        sun: (3,) the direction towards the sun that they were made for.
    """

    ground: NDArray[np.uint32]
    charts: NDArray[np.uint32]
    sun: Array


class LightBaker:
    """Makes light maps of a scene; what does not depend on the sun is computed once."""

    def __init__(self, scene: Scene, geometry: Geometry, rays: RayCaster) -> None:
        self._rays = rays
        half = scene.settings.extent / 2.0
        self._ground_points, self._ground_normals = _grid(scene, half, GROUND_TEXELS)
        points, owner = chart_points(geometry)
        self._chart_points = points.astype(np.float32)
        self._chart_normals = geometry.normals[owner].astype(np.float32)
        self._leaf = geometry.two_sided[owner]
        sky, self._chart_sky = kept(_skies, scene.settings, beside=(self, scene))
        self._ground_sky = _enlarged(sky, GROUND_TEXELS)

    def sky_on_ground(self, scene: Scene) -> Floats:
        """The part (K, K) of the sky's light that arrives on the ground, on a coarse grid."""
        points, normals = _grid(scene, scene.settings.extent / 2.0, _SKY_GRID)
        return self._sky(points, normals, np.zeros(len(points), np.bool_)).reshape(_SKY_GRID, _SKY_GRID)

    def sky_on_charts(self) -> Floats:
        """The part of the sky's light that arrives at each sample of the things' charts."""
        return self._sky(self._chart_points, self._chart_normals, self._leaf)

    def bake(self, sun: Array) -> LightMaps:
        """The maps for the sun in direction ``sun`` (3,); below the horizon there is no sunlight."""
        towards = sun.astype(np.float32)
        not_leaf = np.zeros(len(self._ground_points), np.bool_)
        on_ground = self._sunlight(self._ground_points, self._ground_normals, not_leaf, towards)
        ground = np.stack([on_ground.reshape(GROUND_TEXELS, -1), self._ground_sky], axis=-1).astype(np.float32)
        on_things = self._sunlight(self._chart_points, self._chart_normals, self._leaf, towards)
        return LightMaps(
            ground=np.concatenate([tiled(_pack(level[..., 0], level[..., 1])) for level in mip_levels(ground)]),
            charts=_pack(on_things, self._chart_sky),
            sun=sun.copy(),
        )

    def _sunlight(self, points: Floats, normals: Floats, leaf: NDArray[np.bool_], sun: Floats) -> Floats:
        """Visibility times cosine (S,) at points (S, 3)."""
        cosine = normals @ sun
        scattered = _LEAF_DIFFUSION + (1.0 - _LEAF_DIFFUSION) * np.abs(cosine)
        light: Floats = np.where(leaf, scattered, np.maximum(cosine, 0.0)).astype(np.float32)
        if sun[2] <= 0.0:
            return np.zeros_like(light)
        lit = np.flatnonzero(light > 0.0)
        out = np.zeros_like(light)
        out[lit] = light[lit] * self._sees(points[lit], normals[lit], leaf[lit], sun)
        return out

    def _sky(self, points: Floats, normals: Floats, leaf: NDArray[np.bool_]) -> Floats:
        """The part (S,) of the sky's light that arrives at points (S, 3), by cosine over the visible sky."""
        total = np.zeros(len(points), np.float32)
        for direction in _hemisphere(_SKY_RAYS).astype(np.float32):
            weight = np.where(leaf, 0.5, np.maximum(normals @ direction, 0.0))
            facing = np.flatnonzero(weight > 0.0)
            open_sky = self._sees(points[facing], normals[facing], leaf[facing], direction)
            total[facing] += weight[facing] * np.where(open_sky, 1.0, _BOUNCE)
        below = np.where(leaf, 0.0, _BOUNCE * (1.0 - normals[:, 2]) / 2.0)
        return np.asarray(np.minimum(total / (_SKY_RAYS / 2.0) + below, 1.0))

    def _sees(self, points: Floats, normals: Floats, leaf: NDArray[np.bool_], direction: Floats) -> NDArray[np.bool_]:
        """Whether nothing stands between each point (S, 3) and infinity in a direction (3,)."""
        off = np.where(leaf[:, None], direction, normals) * _OFF_SURFACE + direction * _OFF_SURFACE
        return self._rays.is_free(points + off, np.broadcast_to(direction, points.shape))


def _skies(_settings: SceneSettings, baker: LightBaker, scene: Scene) -> tuple[Floats, Floats]:
    """The sky's light on ground and charts of the scene of these settings."""
    return baker.sky_on_ground(scene), baker.sky_on_charts()


def _grid(scene: Scene, half: float, count: int) -> tuple[Floats, Floats]:
    """Points and normals (count^2, 3) on the ground at the centres of a map's texels, rows along y.

    Heights and normals are interpolated between every fourth metre's part of the smooth hills.
    """
    coarse = (np.arange(_SKY_GRID) + 0.5) * (2.0 * half / _SKY_GRID) - half
    nodes = np.stack(np.meshgrid(coarse, coarse, indexing="xy"), axis=-1)
    axis = (np.arange(count) + 0.5) * (2.0 * half / count) - half
    x, y = np.meshgrid(axis, axis, indexing="xy")
    height = _enlarged(scene.terrain.height(nodes), count)
    slope = scene.terrain.normal(nodes)
    normals = np.stack([_enlarged(slope[..., k], count) for k in range(3)], axis=-1)
    # In single precision, as rays are: there are four million.
    points = np.stack([x, y, height], axis=-1).reshape(-1, 3)
    return points.astype(np.float32), normals.reshape(-1, 3).astype(np.float32)


def _hemisphere(count: int) -> Array:
    """Directions (count, 3), even over the upper hemisphere (Fibonacci lattice)."""
    k = np.arange(count) + 0.5
    z, angle = k / count, np.pi * (1.0 + np.sqrt(5.0)) * k
    r = np.sqrt(1.0 - z * z)
    return np.stack([r * np.cos(angle), r * np.sin(angle), z], axis=-1)


def _enlarged(grid: Array | Floats, count: int) -> Array:
    """A grid (K, K) of cell centres, bilinearly, on (count, count) cells over the same square."""
    return np.asarray(cv2.resize(grid, (count, count), interpolation=cv2.INTER_LINEAR))


def _pack(sun: Floats, sky: Floats) -> NDArray[np.uint32]:
    low, high = (np.rint(np.clip(x, 0.0, 1.0) * 65535.0).astype(np.uint32) for x in (sun, sky))
    packed: NDArray[np.uint32] = low | high << 16
    return packed
