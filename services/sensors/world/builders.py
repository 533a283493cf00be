"""The things that stand in the world: each function builds one, in the world frame, from its place and chance."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike

from common.geometry import Array, so3_exp
from services.sensors.world.mesh import Polygons, cuboid, surface, tube
from services.sensors.world.spectra import MATERIAL_INDEX

_FOLIAGE, _BARK, _BRICK = MATERIAL_INDEX["foliage"], MATERIAL_INDEX["bark"], MATERIAL_INDEX["brick"]
_PLASTER, _PLANKS, _ROCK = MATERIAL_INDEX["plaster"], MATERIAL_INDEX["planks"], MATERIAL_INDEX["rock"]
_FITTINGS = MATERIAL_INDEX["fittings"]
_SUNK = 0.4
"""How deep things reach into the ground, metres, so that no gap shows under them on a slope."""


def _above(height: float) -> Array:
    """The offset (3,) of a height, metres."""
    return np.array([0.0, 0.0, height])


def _upright(yaw: float) -> Array:
    return so3_exp([0.0, 0.0, yaw])


def leaves(centres: Array, sizes: Array, rng: np.random.Generator) -> Polygons:
    """Clusters of leaves: flat two-sided rhombi of any direction at ``centres`` (N, 3), ``sizes`` (N,) metres."""
    n = len(centres)
    a = rng.normal(size=(n, 3))
    a /= np.linalg.norm(a, axis=-1, keepdims=True)
    b = np.cross(a, rng.normal(size=(n, 3)))
    b /= np.linalg.norm(b, axis=-1, keepdims=True)
    a, b = a * sizes[:, None] * 0.5, b * (sizes * rng.uniform(0.3, 0.5, n))[:, None]
    corners = np.stack([centres - a, centres - b, centres + a, centres + b], axis=1)
    tint = rng.uniform([0.5, 0.3, 0.2, 0.2], [1.6, 1.6, 1.5, 1.0], (n, 4))
    return surface(corners, _FOLIAGE, 0.006, rng, tint, two_sided=True)


def _blown(rng: np.random.Generator, wind: int) -> np.random.Generator:
    """Chance of what the wind moves: its own, so that everything else stands as it stood."""
    return np.random.default_rng([int(rng.integers(2**31)), wind])


def crown(centre: ArrayLike, radius: ArrayLike, count: int, rng: np.random.Generator, wind: int) -> Polygons:
    """Foliage (count) in an ellipsoid of half axes ``radius`` (3,), in tufts, so that the sun falls through between."""
    rng = _blown(rng, wind)
    radius = np.asarray(radius, dtype=np.float64)
    tufts = rng.normal(size=(max(6, count // 28), 3))
    tufts *= (rng.random(len(tufts)) ** 0.4 / np.linalg.norm(tufts, axis=-1))[:, None] * 0.85
    own = tufts[rng.integers(0, len(tufts), count)]
    centres = np.asarray(centre) + radius * (own + 0.16 * rng.normal(size=(count, 3)))
    return leaves(centres, rng.uniform(0.16, 0.42, count) * (0.55 + 0.2 * radius.mean()), rng)


def tree(base: Array, rng: np.random.Generator, wind: int) -> list[Polygons]:
    """A trunk with two or three boughs, and its crown, at the ground point ``base`` (3,)."""
    height = rng.uniform(2.6, 4.2)
    lean = np.append(rng.normal(0.0, 0.06, 2), 1.0) * height
    steps = np.linspace(0.0, 1.0, 4)[:, None]
    thick = rng.uniform(0.12, 0.24)
    line = base - _above(_SUNK) + steps * (lean + _above(_SUNK))
    tubes = [tube(line, thick * np.array([1.25, 1.0, 0.85, 0.6]), 8)]
    for _ in range(rng.integers(2, 4)):
        tip = base + lean + rng.normal(0.0, 0.7, 3) + _above(1.1)
        start = base + lean * rng.uniform(0.7, 0.95)
        tubes.append(tube(np.stack([start, tip]), [thick * 0.5, thick * 0.15], 5))
    wood = surface(np.concatenate(tubes), _BARK, 0.004, rng, rng.uniform(0.7, 1.6) * np.ones(4))
    half = np.array([1.0, 1.0, 0.75]) * rng.uniform(1.5, 2.5)
    middle = base + lean + _above(half[2] * 0.6)
    return [wood, crown(middle, half, int(190 * half[0] ** 1.4), rng, wind)]


def bush(base: Array, rng: np.random.Generator, wind: int) -> list[Polygons]:
    """A low crown on the ground."""
    half = rng.uniform([0.4, 0.4, 0.3], [0.9, 0.9, 0.8])
    return [crown(base + _above(half[2] * 0.6), half, 90, rng, wind)]


def tuft(base: Array, rng: np.random.Generator, wind: int) -> Polygons:
    """A tuft of tall grass: upright triangles around a point."""
    rng = _blown(rng, wind)
    n = rng.integers(4, 8)
    angle, height = rng.uniform(0.0, 2.0 * np.pi, n), rng.uniform(0.12, 0.42, n)
    side = np.stack([np.cos(angle), np.sin(angle), np.zeros(n)], axis=-1) * rng.uniform(0.015, 0.05, n)[:, None]
    out = np.stack([-side[:, 1], side[:, 0], np.zeros(n)], axis=-1) * rng.uniform(-4.0, 4.0, n)[:, None]
    tip = base + out + np.stack([np.zeros(n), np.zeros(n), height], axis=-1)
    foot = base + 0.4 * out - _above(0.05)
    corners = np.stack([foot - side, foot + side, tip, tip], axis=1)
    tint = rng.uniform([0.4, 0.4, 0.4, 0.1], [1.8, 1.8, 2.4, 0.5], (n, 4))
    return surface(corners, _FOLIAGE, 0.004, rng, tint, two_sided=True)


def stone(base: Array, rng: np.random.Generator) -> Polygons:
    """An octahedron with each corner moved, half sunk."""
    radius = rng.uniform(0.06, 0.32) * rng.uniform(0.6, 1.2, 6)
    directions = np.concatenate([np.eye(3), -np.eye(3)]) + rng.normal(0.0, 0.2, (6, 3))
    tips = base + (directions * radius[:, None]) @ _upright(rng.uniform(0.0, 6.3)).T * [1.2, 1.2, 0.8]
    faces = [(sx, sy, sz) for sx in (0, 3) for sy in (1, 4) for sz in (2, 5)]
    odd = [(a // 3 + (b - 1) // 3 + (c - 2) // 3) % 2 == 1 for a, b, c in faces]
    loops = [(a, c, b) if flip else (a, b, c) for (a, b, c), flip in zip(faces, odd, strict=True)]
    corners = np.array([[tips[a], tips[b], tips[c], tips[c]] for a, b, c in loops])
    return surface(corners, _ROCK, 0.004, rng, rng.uniform(0.6, 1.9) * rng.uniform(0.8, 1.2, 4))


def crate(base: Array, yaw: float, rng: np.random.Generator) -> Polygons:
    """A box of boards, sometimes with a smaller one on it."""
    half = rng.uniform([0.25, 0.25, 0.2], [0.7, 0.6, 0.55])
    axes = _upright(yaw)
    parts = [cuboid(base + _above(half[2] - _SUNK / 2), axes, half + _above(_SUNK / 2))]
    if rng.random() < 0.4:
        upper = half * [0.6, 0.6, 0.7]
        top = base + _above(2.0 * half[2] + upper[2])
        parts.append(cuboid(top, axes @ _upright(rng.uniform(-0.4, 0.4)), upper))
    return surface(np.concatenate(parts), _PLANKS, 0.004, rng, rng.uniform(0.5, 1.7, 4))


def wall(feet: Array, rng: np.random.Generator) -> list[Polygons]:
    """A wall that follows ground points (K, 3), in upright segments, brick or plaster, with a coping of stone."""
    height, material = rng.uniform(0.9, 1.7), (_BRICK, _PLASTER)[rng.integers(0, 2)]
    faces, caps = [], []
    for a, b in pairwise(feet):
        along = b - a
        axes = _upright(float(np.arctan2(along[1], along[0])))
        half = np.array([np.hypot(*along[:2]) / 2, 0.14, (height + _SUNK) / 2])
        middle = (a + b) / 2 + _above(height / 2 - _SUNK / 2)
        faces.append(cuboid(middle, axes, half))
        caps.append(cuboid(middle + _above(half[2] + 0.03), axes, [half[0], 0.2, 0.04]))
    tint = rng.uniform(0.7, 1.3, 4)
    return [
        surface(np.concatenate(faces), material, 0.006, rng, tint),
        surface(np.concatenate(caps), _ROCK, 0.004, rng, tint),
    ]


def fence(feet: Array, rng: np.random.Generator) -> Polygons:
    """Posts at ground points (K, 3) with two rails between neighbours."""
    post = np.array([0.05, 0.05, 0.35 + _SUNK])
    boards = [cuboid(foot + _above(0.35), _upright(rng.uniform(0.0, 1.5)), post) for foot in feet]
    for a, b in pairwise(feet):
        along = (b - a) / np.linalg.norm(b - a)
        side = np.cross([0.0, 0.0, 1.0], along)
        side /= np.linalg.norm(side)
        axes = np.stack([along, side, np.cross(along, side)], axis=-1)
        for level in (0.55, 0.95):
            middle = (a + b) / 2 + _above(level) + 0.07 * side
            boards.append(cuboid(middle, axes, np.array([np.linalg.norm(b - a) / 2, 0.02, 0.06])))
    return surface(np.concatenate(boards), _PLANKS, 0.004, rng, rng.uniform(0.6, 1.6, 4))


def house(base: Array, yaw: float, half: Array, rng: np.random.Generator) -> list[Polygons]:
    """A house with a gable roof, windows and a door; ``half`` (2,) metres is half its length and depth."""
    height, rise = rng.uniform(2.4, 3.2), rng.uniform(1.0, 1.8)
    axes, material = _upright(yaw), (_BRICK, _PLASTER)[rng.integers(0, 2)]
    tint = rng.uniform(0.7, 1.3, 4)
    body = cuboid(base + _above((height - _SUNK) / 2), axes, [half[0], half[1], (height + _SUNK) / 2])
    parts = [surface(body, material, 0.008, rng, tint)]
    parts.extend(_roof(base + _above(height), axes, half, rise, material, tint, rng))
    parts.append(_openings(base, axes, half, rng))
    return parts


def _roof(
    top: Array, axes: Array, half: Array, rise: float, material: int, tint: Array, rng: np.random.Generator
) -> list[Polygons]:
    """Two slopes that overhang, and the two gables under them, above the walls' top centre ``top`` (3,)."""
    x, y, z = (axes[:, k] for k in range(3))
    slope = rise / half[1]
    over = 0.3
    ridge = top + z * (rise + 0.05)
    slopes, gables = [], []
    for side in (1.0, -1.0):
        eave = top + side * y * (half[1] + over) - z * (over * slope - 0.05)
        ends = side * x * (half[0] + over)
        upper = [eave + ends, eave - ends, ridge - ends, ridge + ends]
        slopes.extend([upper, upper[::-1]])
        end = top + side * x * half[0]
        gables.append([end - side * y * half[1], end + side * y * half[1], end + z * rise, end + z * rise])
    return [
        surface(slopes, _BRICK, 0.012, rng, rng.uniform(0.5, 1.2, 4)),
        surface(gables, material, 0.008, rng, tint),
    ]


def _openings(base: Array, axes: Array, half: Array, rng: np.random.Generator) -> Polygons:
    """Windows in white frames, and doors, a hand's breadth before the walls."""
    quads, weights = [], []
    glass, frame, door = [2.0, 0.3, 0.0, 0.1], [0.0, 0.2, 2.0, 0.2], [0.3, 0.5, 0.2, 2.0]
    for k, sign in ((0, 1.0), (0, -1.0), (1, 1.0), (1, -1.0)):
        normal = sign * axes[:, k]
        along = np.cross([0.0, 0.0, 1.0], normal)
        reach = half[1 - k]
        for place in np.arange(-reach + 1.1, reach - 0.9, 2.1):
            is_door = rng.random() < 0.2
            size = np.array([0.5, 1.0]) if is_door else rng.uniform([0.35, 0.4], [0.6, 0.7])
            middle = base + normal * (half[k] + 0.02) + along * place + _above(1.0 if is_door else 1.5)
            quads.append(_panel(middle, along, size + 0.09))
            quads.append(_panel(middle + normal * 0.02, along, size))
            weights.extend([frame, door if is_door else glass])
    return surface(quads, _FITTINGS, 0.004, rng, np.array(weights))


def _panel(middle: Array, along: Array, size: Array) -> Array:
    """An upright rectangle (4, 3) of half extents ``size`` (2,)."""
    u, v = along * size[0], np.array([0.0, 0.0, size[1]])
    return np.stack([middle - u - v, middle + u - v, middle + u + v, middle - u + v])
