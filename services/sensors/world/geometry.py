"""The scene's polygons in the flat single-precision arrays that the compiled renderer reads."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from common.geometry import Array
from services.sensors.world.mesh import Polygons, normals, plane_axes
from services.sensors.world.spectra import MATERIAL_INDEX

Floats = NDArray[np.float32]

MATERIAL, TEXTURE, CHART_START, CHART_WIDTH, CHART_HEIGHT = range(5)
"""Columns of :attr:`Geometry.indices`; a chart width of 0 stands for the ground's shadow map."""
INDICES = 5

_CHART_STEP = 0.14
"""Metres between samples of light on things."""
_CHART_MOST = 48


@dataclass(frozen=True, slots=True)
class Geometry:
    """N polygons in G groups.

    Attributes:
        corners: (N, 4, 3) float32, metres, world frame.
        sizes: (N,) int32, 3 or 4 corners.
        normals: (N, 3) float64.
        two_sided: (N,) whether it is seen from behind.
        maps: (N, 4, 4) rows that take ``[x, y, z, 1]`` to two texels of the detail texture, and to two of the ground's
            map or, for things, two samples of the light chart.
        weights: (N, 4) factors of the detail texture's four lanes.
        indices: (N, :data:`INDICES`) int64.
        group_starts: (G + 1,) int64 first polygon of each group.
        group_spheres: (G, 4) centre and radius of each group, metres.
    """

    corners: Floats
    sizes: NDArray[np.int32]
    normals: Array
    two_sided: NDArray[np.bool_]
    maps: Array
    weights: Array
    indices: NDArray[np.int64]
    group_starts: NDArray[np.int64]
    group_spheres: Array

    @classmethod
    def of(cls, groups: tuple[Polygons, ...], ground_map: Array) -> Geometry:
        """Of the scene's groups and the map (2, 4) from the world to texels of the ground's map."""
        corners = np.concatenate([g.corners for g in groups])
        starts = np.cumsum([0, *(len(g) for g in groups)]).astype(np.int64)
        ground = np.concatenate([np.full(len(g), g.ground) for g in groups])
        two_sided = np.concatenate([np.full(len(g), g.two_sided) for g in groups])
        material = np.concatenate([g.material for g in groups])
        indices = np.zeros((len(corners), INDICES), np.int64)
        indices[:, MATERIAL] = indices[:, TEXTURE] = material
        uniform = two_sided | (material == MATERIAL_INDEX["ground"])
        light, width, height = _charts(corners, uniform)
        width[ground], height[ground] = 0, 0
        light[material == MATERIAL_INDEX["ground"]] = ground_map
        indices[:, CHART_WIDTH], indices[:, CHART_HEIGHT] = width, height
        indices[:, CHART_START] = np.cumsum(width * height) - width * height
        triangle = (corners[:, 2] == corners[:, 3]).all(axis=-1)
        return cls(
            corners=corners.astype(np.float32),
            sizes=np.where(triangle, 3, 4).astype(np.int32),
            normals=normals(corners),
            two_sided=two_sided,
            maps=np.concatenate([np.concatenate([g.uv for g in groups]), light], axis=1),
            weights=np.concatenate([g.weights for g in groups]),
            indices=indices,
            group_starts=starts,
            group_spheres=np.array([_sphere(g.corners.reshape(-1, 3)) for g in groups]),
        )

    def triangles(self) -> tuple[Floats, NDArray[np.int64]]:
        """Triangles (T, 3, 3) for ray casting, and each one's polygon (T,)."""
        quads = np.flatnonzero(self.sizes == 4)
        both = np.concatenate([self.corners[:, [0, 1, 2]], self.corners[quads][:, [0, 2, 3]]])
        return np.ascontiguousarray(both), np.concatenate([np.arange(len(self.corners)), quads])


def _sphere(points: Array) -> Array:
    """Centre and radius (4,) of a sphere around points (P, 3)."""
    centre = (points.min(axis=0) + points.max(axis=0)) / 2.0
    return np.append(centre, np.linalg.norm(points - centre, axis=-1).max())


def _charts(corners: Array, uniform: NDArray[np.bool_]) -> tuple[Array, NDArray[np.int64], NDArray[np.int64]]:
    """Each polygon's map (N, 2, 4) from the world to samples of its light chart, and the chart's sizes (N,), (N,).

    A chart's outer samples lie on the bounding rectangle of its polygon, so interpolation never leaves it.
    One that is lit evenly, such as a leaf, has a single sample.
    """
    axes = np.stack(plane_axes(corners), axis=1)
    flat = np.einsum("nij,nkj->nki", axes, corners)
    low, high = flat.min(axis=1), flat.max(axis=1)
    span = high - low
    counts = np.clip(np.ceil(span / _CHART_STEP).astype(np.int64) + 1, 2, _CHART_MOST)
    counts[uniform] = 1
    scale = (counts - 1) / span
    maps = np.concatenate([axes * scale[..., None], -(low * scale)[..., None]], axis=-1)
    return maps, counts[:, 0], counts[:, 1]


def chart_points(geometry: Geometry) -> tuple[Array, NDArray[np.int64]]:
    """World points (S, 3) of all samples of all light charts in their order, and each one's polygon (S,).

    The outermost samples are drawn in by a twentieth, off the neighbours that meet there.
    """
    width, height = geometry.indices[:, CHART_WIDTH], geometry.indices[:, CHART_HEIGHT]
    area = width * height
    owner = np.repeat(np.arange(len(area)), area)
    k = np.arange(area.sum()) - np.repeat(geometry.indices[:, CHART_START], area)
    w, h = width[owner], height[owner]
    corners = geometry.corners.astype(np.float64)
    axes = np.stack(plane_axes(corners), axis=1)
    flat = np.einsum("nij,nkj->nki", axes, corners)
    low, span = flat.min(axis=1), np.ptp(flat, axis=1)
    part = np.stack([(k % w) / np.maximum(w - 1, 1), (k // w) / np.maximum(h - 1, 1)], axis=-1)
    part = np.where(np.stack([w, h], axis=-1) == 1, 0.5, 0.05 + 0.9 * part)
    place = low[owner] + part * span[owner]
    depth = np.einsum("ni,ni->n", geometry.normals, corners[:, 0])
    return np.asarray(np.einsum("ni,nij->nj", place, axes[owner]) + depth[owner, None] * geometry.normals[owner]), owner
