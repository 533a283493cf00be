"""The ground as triangles: fine in the furnished square, coarser towards the hills at the horizon."""

from __future__ import annotations

import numpy as np

from common.geometry import Array
from services.sensors.world.mesh import Polygons
from services.sensors.world.settings import SceneSettings
from services.sensors.world.spectra import MATERIAL_INDEX
from services.sensors.world.terrain import Terrain

_TEXEL = 0.005
"""Metres of a texel of the ground's detail."""
_BLOCK = 8
"""Cells to a side of a block, which is culled as one."""


def ground_blocks(terrain: Terrain, settings: SceneSettings, rng: np.random.Generator) -> list[Polygons]:
    """The ground in blocks; those in the furnished square are marked as ``ground``."""
    half = settings.extent / 2
    inner = np.linspace(-half, half, round(settings.extent) + 1)
    ring = half + np.geomspace(2.0, settings.horizon - half, 24)
    axis = np.concatenate([-ring[::-1], inner, ring])
    x, y = np.meshgrid(axis, axis, indexing="ij")
    z = terrain.height(np.stack([x, y], axis=-1)) + _hills(x, y, half)
    nodes = np.stack([x, y, z, *_bent_texture(x, y, rng)], axis=-1)
    inside = (np.abs(x[:-1, :-1] + x[1:, 1:]) < 2 * half) & (np.abs(y[:-1, :-1] + y[1:, 1:]) < 2 * half)
    blocks: list[Polygons] = []
    for i in range(0, len(axis) - 1, _BLOCK):
        for j in range(0, len(axis) - 1, _BLOCK):
            cells = (slice(i, min(i + _BLOCK, len(axis) - 1)), slice(j, min(j + _BLOCK, len(axis) - 1)))
            triangles = _triangles(nodes[i : cells[0].stop + 1, j : cells[1].stop + 1])
            baked = np.repeat(inside[cells].ravel(), 2)
            blocks.extend(
                _polygons(triangles[baked == flag], ground=flag) for flag in (True, False) if (baked == flag).any()
            )
    return blocks


def _hills(x: Array, y: Array, half: float) -> Array:
    """What the ground rises beyond the square, metres, so that the horizon is a line of hills."""
    out = np.maximum(0.0, np.hypot(x, y) - 1.5 * half)
    bearing = np.arctan2(y, x)
    return np.asarray(2.2e-3 * out**1.5 * (1.0 + 0.5 * np.sin(3 * bearing + 1.0) + 0.35 * np.sin(7 * bearing)))


def _bent_texture(x: Array, y: Array, rng: np.random.Generator) -> tuple[Array, Array]:
    """Texel coordinates u and v, bent by slow waves, so that the repeated detail never looks the same twice."""
    u, v = x.copy(), y.copy()
    for length in (41.0, 23.0, 13.0):
        angle, phase = rng.uniform(0.0, 2.0 * np.pi, 2), rng.uniform(0.0, 2.0 * np.pi, 2)
        bend = 0.06 * length
        u += bend * np.sin(2 * np.pi / length * (np.cos(angle[0]) * x + np.sin(angle[0]) * y) + phase[0])
        v += bend * np.sin(2 * np.pi / length * (np.cos(angle[1]) * x + np.sin(angle[1]) * y) + phase[1])
    return u / _TEXEL, v / _TEXEL


def _triangles(nodes: Array) -> Array:
    """Two triangles a cell, (2*(I-1)*(J-1), 3, 5), of grid nodes (I, J, 5), seen from above."""
    a, b, c, d = nodes[:-1, :-1], nodes[1:, :-1], nodes[1:, 1:], nodes[:-1, 1:]
    pairs = np.stack([np.stack([a, b, c], axis=2), np.stack([a, c, d], axis=2)], axis=2)
    return pairs.reshape(-1, 3, nodes.shape[-1])


def _polygons(triangles: Array, *, ground: bool) -> Polygons:
    """Triangles (N, 3, 5) ``[x, y, z, u, v]`` as polygons; texels are affine in x and y on each."""
    n = len(triangles)
    plan = np.concatenate([triangles[..., :2], np.ones((n, 3, 1))], axis=-1)
    affine = np.swapaxes(np.linalg.solve(plan, triangles[..., 3:]), -1, -2)
    uv = np.zeros((n, 2, 4))
    uv[..., :2], uv[..., 3] = affine[..., :2], affine[..., 2]
    # A texture coordinate of many thousand texels loses its fraction in single precision.
    centre = np.floor(np.einsum("nij,nj->ni", affine, plan.mean(axis=1)) / 1024.0) * 1024.0
    uv[..., 3] -= centre
    corners = triangles[:, [0, 1, 2, 2], :3]
    weights = np.full((n, 4), 2.2)
    return Polygons(
        corners, uv, weights, np.full(n, MATERIAL_INDEX["ground"], np.int32), two_sided=False, ground=ground
    )
