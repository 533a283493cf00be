"""Flat polygons of three or four corners: the only thing that the world is built of."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from common.geometry import Array


@dataclass(frozen=True, slots=True)
class Polygons:
    """N convex flat polygons of one thing, in the world frame.

    Attributes:
        corners: (N, 4, 3) metres, counter-clockwise seen from outside; a triangle repeats its third corner.
        uv: (N, 2, 4) maps ``[x, y, z, 1]`` to texels of the detail texture.
        weights: (N, 4) factors of the detail texture's four lanes.
        material: (N,) index of :data:`~services.sensors.world.spectra.MATERIALS`.
        two_sided: seen from behind too, and lit from either side as leaves are.
        ground: takes the world's ground map and shadow map.
    """

    corners: Array
    uv: Array
    weights: Array
    material: NDArray[np.int32]
    two_sided: bool = False
    ground: bool = False

    def __len__(self) -> int:
        return len(self.corners)


def normals(corners: Array) -> Array:
    """Unit normals (N, 3) of polygons (N, 4, 3), from their diagonals."""
    n = np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1])
    triangle = (corners[:, 2] == corners[:, 3]).all(axis=-1)
    n[triangle] = np.cross(corners[triangle, 1] - corners[triangle, 0], corners[triangle, 2] - corners[triangle, 0])
    return np.asarray(n / np.linalg.norm(n, axis=-1, keepdims=True))


def plane_axes(corners: Array) -> tuple[Array, Array]:
    """Two orthogonal unit axes (N, 3) in each polygon's plane, the first along its first edge."""
    first = corners[:, 1] - corners[:, 0]
    first = first / np.linalg.norm(first, axis=-1, keepdims=True)
    return first, np.cross(normals(corners), first)


def planar_uv(corners: Array, texel: float, offset: ArrayLike = 0.0) -> Array:
    """``uv`` (N, 2, 4) that lays a texture of ``texel`` metres flat on each polygon.

    ``offset`` (2,) or (N, 2) texels is the texture's place at the first corner.
    """
    axes = np.stack(plane_axes(corners), axis=1) / texel
    origin = np.broadcast_to(np.asarray(offset, dtype=np.float64), (len(corners), 2))
    shift = origin - np.einsum("nij,nj->ni", axes, corners[:, 0])
    return np.concatenate([axes, shift[..., None]], axis=-1)


def surface(
    corners: ArrayLike,
    material: int,
    texel: float,
    rng: np.random.Generator,
    weights: ArrayLike,
    *,
    two_sided: bool = False,
) -> Polygons:
    """Polygons (N, 4, 3) with a flat texture at a random place, and ``weights`` (4,) or (N, 4)."""
    corners = np.asarray(corners, dtype=np.float64)
    n = len(corners)
    factors = np.broadcast_to(np.asarray(weights, dtype=np.float64), (n, 4)).copy()
    uv = planar_uv(corners, texel, rng.integers(0, 1024, (n, 2)))
    return Polygons(corners, uv, factors, np.full(n, material, np.int32), two_sided)


def joined(parts: list[Polygons]) -> Polygons:
    """Several polygons of one thing as one."""
    fields = ("corners", "uv", "weights", "material")
    corners, uv, weights, material = (np.concatenate([getattr(p, f) for p in parts]) for f in fields)
    return Polygons(corners, uv, weights, material, parts[0].two_sided, parts[0].ground)


def cuboid(centre: ArrayLike, axes: ArrayLike, half: ArrayLike) -> Array:
    """The six faces (6, 4, 3), seen from outside, of a box.

    ``axes`` (3, 3) has the box's unit axes in its columns, ``half`` (3,) their half lengths in metres.
    """
    centre, edges = np.asarray(centre, dtype=np.float64), np.asarray(axes) * np.asarray(half)
    faces = []
    for k in range(3):
        u, v, n = edges[:, (k + 1) % 3], edges[:, (k + 2) % 3], edges[:, k]
        for sign in (1.0, -1.0):
            loop = [-u - sign * v, u - sign * v, u + sign * v, -u + sign * v]
            # Textures lie along the first edge: it is level on every upright face.
            first = 1 if k == 1 else 0
            faces.append([centre + sign * n + corner for corner in loop[first:] + loop[:first]])
    return np.asarray(faces)


def tube(centres: Array, radii: ArrayLike, sides: int) -> Array:
    """The faces ((K-1)*sides, 4, 3) of a tapering tube along points (K, 3) with radii (K,), cut level.

    Every face is a trapezium, hence flat, where ``centres`` rise straight or the bend is slight: faces of a
    bent tube are split into triangles.
    """
    angle = np.linspace(0.0, 2.0 * np.pi, sides, endpoint=False)
    ring = np.stack([np.cos(angle), np.sin(angle), np.zeros(sides)], axis=-1)
    rings = centres[:, None] + np.asarray(radii)[:, None, None] * ring
    low, high = rings[:-1], rings[1:]
    a, b = low, np.roll(low, -1, axis=1)
    c, d = np.roll(high, -1, axis=1), high
    lower, upper = np.stack([a, b, c, c], axis=2), np.stack([a, c, d, d], axis=2)
    return np.concatenate([lower.reshape(-1, 4, 3), upper.reshape(-1, 4, 3)])
