"""Rays through the scene (Intel Embree)."""

from __future__ import annotations

import numpy as np
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene
from numpy.typing import NDArray

from common.geometry import Array
from services.sensors.world.geometry import Floats, Geometry

_FAR = 1e6


class RayCaster:
    """The scene's triangles in a bounding volume hierarchy."""

    def __init__(self, geometry: Geometry) -> None:
        triangles, self._polygons = geometry.triangles()
        self._scene = EmbreeScene()
        self._mesh = TriangleMesh(self._scene, triangles)

    def first_hits(self, origins: Array | Floats, directions: Array | Floats) -> tuple[Array, NDArray[np.int64]]:
        """Distances (N,) in metres, infinite for a miss, and polygons (N,), -1 for a miss.

        ``origins`` (N, 3) metres, ``directions`` (N, 3) of length one.
        """
        hits = self._scene.run(_single(origins), _single(directions), output=True)
        triangle = np.asarray(hits["primID"], dtype=np.int64)
        miss = triangle < 0
        distance = np.where(miss, np.inf, np.asarray(hits["tfar"], dtype=np.float64))
        return distance, np.where(miss, -1, self._polygons[np.where(miss, 0, triangle)])

    def is_free(self, origins: Array | Floats, directions: Array | Floats) -> NDArray[np.bool_]:
        """Whether each ray (N, 3), (N, 3) leaves the scene without hitting anything."""
        return np.asarray(self._scene.run(_single(origins), _single(directions), query="OCCLUDED") != 0)


def _single(vectors: Array | Floats) -> Floats:
    return np.ascontiguousarray(vectors, dtype=np.float32)
