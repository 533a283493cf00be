"""The ground's shape: gentle hills as a sum of waves, smooth and with exact slopes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from common.geometry import Array, transform

_WAVES = 24
_SHORTEST, _LONGEST = 12.0, 60.0


@dataclass(frozen=True, slots=True)
class Terrain:
    """Height ``z(x, y) = sum a_i sin(k_i . [x, y] + p_i)``, metres.

    Attributes:
        wave_vectors: (W, 2), rad/m.
        amplitudes, phases: (W,), metres and radians.
    """

    wave_vectors: Array
    amplitudes: Array
    phases: Array

    @classmethod
    def random(cls, rng: np.random.Generator, relief: float) -> Terrain:
        """Hills of 12 to 60 m with a standard deviation of ``relief`` metres, long ones higher."""
        lengths = np.geomspace(_SHORTEST, _LONGEST, _WAVES)
        directions = rng.uniform(0.0, 2.0 * np.pi, _WAVES)
        vectors = (2.0 * np.pi / lengths)[:, None] * np.stack([np.cos(directions), np.sin(directions)], -1)
        amplitudes = lengths / np.sqrt((lengths**2).sum() / 2.0) * relief
        return cls(vectors, amplitudes, rng.uniform(0.0, 2.0 * np.pi, _WAVES))

    def height(self, xy: ArrayLike) -> Array:
        """Heights (...), metres, at points (..., 2)."""
        phase = np.asarray(xy, dtype=np.float64) @ self.wave_vectors.T + self.phases
        return np.asarray(np.sin(phase) @ self.amplitudes)

    def slope(self, xy: ArrayLike) -> Array:
        """Derivatives (..., 2) of the height by x and y."""
        phase = np.asarray(xy, dtype=np.float64) @ self.wave_vectors.T + self.phases
        return np.asarray((np.cos(phase) * self.amplitudes) @ self.wave_vectors)

    def normal(self, xy: ArrayLike) -> Array:
        """Unit normals (..., 3) that point up."""
        return _normal(self.slope(xy))

    def standing(self, x: ArrayLike, y: ArrayLike, yaw: ArrayLike) -> Array:
        """``T_world_vehicle`` (..., 4, 4) of vehicles that stand at (x, y) and head for ``yaw`` from above, (...)."""
        xy, angle = np.stack([x, y], axis=-1), np.asarray(yaw, dtype=np.float64)
        slope = self.slope(xy)
        up = _normal(slope)
        heading = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
        forward = np.concatenate([heading, (heading * slope).sum(axis=-1, keepdims=True)], axis=-1)
        forward /= np.linalg.norm(forward, axis=-1, keepdims=True)
        rotation = np.stack([forward, np.cross(up, forward), up], axis=-1)
        return transform(rotation, np.concatenate([xy, self.height(xy)[..., None]], axis=-1))


def _normal(slope: Array) -> Array:
    """Unit normals (..., 3) of slopes (..., 2)."""
    n = np.concatenate([-slope, np.ones((*slope.shape[:-1], 1))], axis=-1)
    return np.asarray(n / np.linalg.norm(n, axis=-1, keepdims=True))
