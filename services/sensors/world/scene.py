"""A scene: terrain and everything that stands on it, as flat polygons in groups, made from a seed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np

from common.geometry import Array
from services.sensors.world import builders
from services.sensors.world.ground import ground_blocks
from services.sensors.world.mesh import Polygons
from services.sensors.world.noise import Image
from services.sensors.world.route import waisted_loop
from services.sensors.world.settings import SceneSettings
from services.sensors.world.terrain import Terrain
from services.sensors.world.textures import DETAILS, TextureSet, ground_map

GROUND_TEXELS = 2048
"""Side of the ground's map and of its shadow map, which cover the furnished square."""
_TRIES = 40


@dataclass(frozen=True, slots=True)
class Scene:
    """What the world is made of.

    Attributes:
        settings: what it was drawn from.
        terrain: the ground's height.
        groups: the things, each a bounded cluster of polygons.
        textures: details by material index, then the ground map.
    """

    settings: SceneSettings
    terrain: Terrain
    groups: tuple[Polygons, ...]
    textures: TextureSet

    @classmethod
    def build(cls, settings: SceneSettings) -> Scene:
        """Draw a scene; the same settings give the same scene.

        Raises:
            ValueError: the route does not fit into the extent.
        """
        rng = np.random.default_rng(settings.seed)
        route = waisted_loop(settings.route_length)
        if np.abs(route[:, :2]).max() > settings.extent / 2 - 10.0:
            raise ValueError(f"a route of {settings.route_length} m does not fit into {settings.extent} m")
        terrain = Terrain.random(rng, settings.relief)
        things = _Furnisher(settings, terrain, route, rng).furnish()
        ground = ground_blocks(terrain, settings, rng)
        textures = [draw(rng) for draw in DETAILS.values()]
        textures.append(ground_map(rng, GROUND_TEXELS, _worn(route, settings.extent)))
        return cls(settings, terrain, tuple(ground + things), TextureSet.of(textures))

    def demo_route(self) -> Array:
        """Poses (N, 3) ``[x, y, yaw]``, metres and radians, 0.1 m apart, that keep clear of every obstacle."""
        return waisted_loop(self.settings.route_length)

    def ground_map(self) -> Array:
        """The map (2, 4) that takes ``[x, y, z, 1]`` to texels of the ground's map."""
        scale = GROUND_TEXELS / self.settings.extent
        return np.array([[scale, 0.0, 0.0, GROUND_TEXELS / 2.0], [0.0, scale, 0.0, GROUND_TEXELS / 2.0]])


def _worn(route: Array, extent: float) -> Image:
    """How much of the ground's green is worn off by driving, (S, S) in 0..1, along the route."""
    canvas = np.zeros((GROUND_TEXELS, GROUND_TEXELS), np.float32)
    scale = GROUND_TEXELS / extent
    points = np.rint(route[:, :2] * scale + GROUND_TEXELS / 2).astype(np.int32)
    cv2.polylines(canvas, [points], isClosed=False, color=1.0, thickness=round(1.2 * scale))
    return np.asarray(cv2.GaussianBlur(canvas, (0, 0), 0.35 * scale))


class _Furnisher:
    """Places things one after the other where they are clear of the route and of each other."""

    def __init__(self, settings: SceneSettings, terrain: Terrain, route: Array, rng: np.random.Generator) -> None:
        self._settings, self._terrain, self._route, self._rng = settings, terrain, route, rng
        self._taken = np.zeros((0, 3))

    def furnish(self) -> list[Polygons]:
        """All things, the large ones first."""
        s = self._settings
        groups: list[Polygons] = []
        for _ in range(s.houses):
            groups.extend(self._house())
        for _ in range(s.walls):
            groups.extend(self._row(lambda feet: builders.wall(feet, self._rng), 5.0, 12.0, 2.0))
        for _ in range(s.fences):
            groups.extend(self._row(lambda feet: [builders.fence(feet, self._rng)], 2.4, 9.0, 1.8))
        rng, wind = self._rng, s.wind
        groups.extend(self._scatter(s.trees, 0.45, (0.4, 16.0), 1.6, lambda p: builders.tree(p, rng, wind)))
        groups.extend(
            self._scatter(s.boxes, 0.9, (0.1, 8.0), 0.2, lambda p: [builders.crate(p, rng.uniform(0, 6.3), rng)])
        )
        groups.extend(self._scatter(s.bushes, 1.0, (0.1, 14.0), 0.1, lambda p: builders.bush(p, rng, wind)))
        groups.extend(self._scatter(s.stones, 0.4, (-0.3, 10.0), 0.0, lambda p: [builders.stone(p, rng)]))
        groups.extend(self._scatter(s.tufts, 0.3, (-0.6, 12.0), 0.0, lambda p: [builders.tuft(p, rng, wind)]))
        return groups

    def _on_ground(self, xy: Array) -> Array:
        return np.concatenate([xy, self._terrain.height(xy)[..., None]], axis=-1)

    def _beside_route(self, least: float, most: float) -> Array:
        """A point (2,) at a lateral distance from the route drawn between two, on either side."""
        x, y, yaw = self._route[self._rng.integers(len(self._route))]
        offset = self._rng.uniform(least, most) * self._rng.choice([-1.0, 1.0])
        return np.array([x - np.sin(yaw) * offset, y + np.cos(yaw) * offset])

    def _is_free(self, points: Array, radius: float, gap: float) -> bool:
        """Whether circles at ``points`` (K, 2) are inside the square, clear of the route and of what stands."""
        if np.abs(points).max() > self._settings.extent / 2 - radius - 1.0:
            return False
        to_route = np.linalg.norm(points[:, None] - self._route[None, :, :2], axis=-1).min()
        if to_route < radius + gap:
            return False
        apart = np.linalg.norm(points[:, None] - self._taken[None, :, :2], axis=-1)
        return bool((apart > radius + self._taken[:, 2]).all())

    def _take(self, points: Array, radius: float) -> None:
        self._taken = np.concatenate([self._taken, np.column_stack([points, np.full(len(points), radius)])])

    def _scatter(
        self,
        count: int,
        radius: float,
        lateral: tuple[float, float],
        apart: float,
        build: Callable[[Array], list[Polygons]],
    ) -> list[Polygons]:
        """``count`` things of a radius, ``lateral`` metres beyond the route's clearance, ``apart`` from each other."""
        groups: list[Polygons] = []
        clear = self._settings.clearance
        for _ in range(count):
            for _ in range(_TRIES):
                point = self._beside_route(clear + radius + lateral[0], clear + radius + lateral[1])[None]
                if self._is_free(point, radius, clear):
                    self._take(point, radius + apart)
                    groups.extend(build(self._on_ground(point[0])))
                    break
        return groups

    def _row(self, build: Callable[[Array], list[Polygons]], least: float, most: float, step: float) -> list[Polygons]:
        """Something long beside the route and roughly along it, of four to seven segments of ``step`` metres."""
        for _ in range(_TRIES):
            x, y, yaw = self._route[self._rng.integers(len(self._route))]
            offset = self._rng.uniform(least, most) * self._rng.choice([-1.0, 1.0])
            heading = (
                yaw + self._rng.normal(0.0, 0.15) + np.arange(self._rng.integers(4, 8)) * self._rng.normal(0.0, 0.12)
            )
            steps = step * np.stack([np.cos(heading), np.sin(heading)], axis=-1)
            middle = np.array([x - np.sin(yaw) * offset, y + np.cos(yaw) * offset])
            feet = middle + np.cumsum(steps, axis=0) - steps.sum(0) / 2
            dense = np.concatenate([feet[:-1] + f * np.diff(feet, axis=0) for f in (0.0, 0.25, 0.5, 0.75, 1.0)])
            if self._is_free(dense, 0.4, self._settings.clearance):
                self._take(dense, 0.5)
                return build(self._on_ground(feet))
        return []

    def _house(self) -> list[Polygons]:
        for _ in range(_TRIES):
            half = self._rng.uniform([3.0, 2.2], [5.0, 3.4])
            radius = float(np.hypot(*half)) + 0.3
            point = self._beside_route(radius + 3.0, radius + 11.0)[None]
            if self._is_free(point, radius, self._settings.clearance + 1.0):
                self._take(point, radius)
                return builders.house(self._on_ground(point[0]), self._rng.uniform(0.0, 6.3), half, self._rng)
        return []
