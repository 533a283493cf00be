"""The world's textures: in each texel four weights, one for each endmember of a material.

A texel is a uint32 of four bytes. Lighting never enters a texture, so every light shows the same surfaces.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from services.sensors.world.noise import Image, contrast, fractal, spots, strokes

Texels = NDArray[np.uint32]
_TILE = 4
_SIZE = 512
"""Side of the details of things, texels; the ground's is twice as large, for it is seen most."""


@dataclass(frozen=True, slots=True)
class TextureSet:
    """Square textures with all their mip levels in one array.

    Attributes:
        texels: (T,) uint32, level 0 first, then each of half the size down to 1x1, as :func:`tiled`.
        starts: (K,) where each texture's level 0 begins.
        logs: (K,) binary logarithm of each texture's side.
    """

    texels: Texels
    starts: NDArray[np.int64]
    logs: NDArray[np.int64]

    @classmethod
    def of(cls, textures: list[Image]) -> TextureSet:
        """Of images (S, S, 4) in 0..1, each S a power of two."""
        chains = [np.concatenate([tiled(_pack(level)) for level in mip_levels(image)]) for image in textures]
        starts = np.cumsum([0, *(len(c) for c in chains[:-1])])
        logs = np.array([image.shape[0].bit_length() - 1 for image in textures], dtype=np.int64)
        return cls(np.concatenate(chains), starts.astype(np.int64), logs)


def mip_levels(image: Image) -> list[Image]:
    """The image (S, S, C) and its halvings down to 1x1, each pixel the mean of four."""
    levels = [image]
    while levels[-1].shape[0] > 1:
        half = levels[-1].shape[0] // 2
        smaller = cv2.resize(levels[-1], (half, half), interpolation=cv2.INTER_AREA)
        levels.append(smaller.reshape(half, half, -1).astype(np.float32))
    return levels


def tiled(image: Texels) -> Texels:
    """An image (S, S) as one row of tiles of 4x4 texels, each a cache line; images of less than a tile as they are.

    A camera crosses the ground's map at any angle, where whole rows would touch a line of cache a texel.
    """
    side = image.shape[0]
    if side < _TILE:
        return image.ravel()
    return image.reshape(side // _TILE, _TILE, side // _TILE, _TILE).swapaxes(1, 2).ravel()


def _pack(image: Image) -> Texels:
    """Images (S, S, 4) in 0..1 as uint32, the first channel in the lowest byte."""
    lanes = np.rint(np.clip(image, 0.0, 1.0) * 255.0).astype(np.uint32)
    packed: Texels = lanes[..., 0] | lanes[..., 1] << 8 | lanes[..., 2] << 16 | lanes[..., 3] << 24
    return packed


def _stack(*lanes: NDArray[np.floating]) -> Image:
    return np.asarray(np.clip(np.stack(lanes, axis=-1), 0.0, 1.0).astype(np.float32))


def _patches(rng: np.random.Generator, shortest: float = 4.0, longest: float = 256.0, size: int = _SIZE) -> Image:
    """Light and dark patches of many sizes, in 0.55..1.15."""
    return 0.55 + 0.6 * contrast(fractal(rng, size, shortest, longest, 0.6), 1.8)


def ground_detail(rng: np.random.Generator) -> Image:
    """Blades of green and dry grass, crumbs of soil, gravel."""
    size = 2 * _SIZE
    green = np.full((size, size), 0.3, np.float32)
    strokes(green, rng, 9000, (14, 60), (0.35, 1.0))
    dry = np.full((size, size), 0.35, np.float32)
    strokes(dry, rng, 6000, (16, 80), (0.3, 1.0))
    soil = 0.45 + 0.13 * fractal(rng, size, 3, 64, 0.7)
    spots(soil, rng, 3500, (1.5, 12), (0.25, 0.95))
    gravel = np.full((size, size), 0.3, np.float32)
    spots(gravel, rng, 9000, (3, 20), (0.4, 0.95))
    return _stack(*(lane * _patches(rng, 8.0, 300.0, size) for lane in (green, dry, soil, gravel)))


def bark_detail(rng: np.random.Generator) -> Image:
    """Ridges along v, with lichen and dark cracks."""
    tall = np.asarray(
        cv2.resize(fractal(rng, _SIZE, 6, 128, 0.6)[: _SIZE // 4], (_SIZE, _SIZE), interpolation=cv2.INTER_CUBIC),
        np.float32,
    )
    ridge = contrast(tall, 2.5) * _patches(rng)
    cracks = np.zeros((_SIZE, _SIZE), np.float32)
    strokes(cracks, rng, 650, (10, 70), (0.2, 1.0), 0.3)
    cracks = cracks.T.copy()
    lichen = np.zeros((_SIZE, _SIZE), np.float32)
    spots(lichen, rng, 180, (2, 26), (0.1, 1.0))
    free = 1.0 - np.maximum(cracks, lichen)
    return _stack(0.9 * ridge * free, 0.5 * (1.0 - ridge) * free, lichen, cracks)


def foliage_detail(rng: np.random.Generator) -> Image:
    """Leaves over leaves, light and dark, with gaps of shade."""
    leaves = np.full((_SIZE, _SIZE), 0.08, np.float32)
    spots(leaves, rng, 4000, (5, 20), (0.1, 1.0))
    young = contrast(fractal(rng, _SIZE, 10, 200, 0.5), 2.5)
    withered = contrast(fractal(rng, _SIZE, 12, 120, 0.4) - 1.6, 5.0)
    return _stack(leaves * (1.0 - young), leaves * young * (1.0 - withered), leaves * withered, 1.0 - leaves)


def brick_detail(rng: np.random.Generator) -> Image:
    """Courses of 16 x 64 texels, every brick of its own shade, with stains."""
    v, u = np.mgrid[0:_SIZE, 0:_SIZE]
    row = v // 16
    shifted = (u + (row % 2) * 32) % _SIZE
    joint = ((v % 16) < 2) | ((shifted % 64) < 3)
    shade = rng.uniform(0.25, 1.0, (_SIZE // 16, _SIZE // 64)).astype(np.float32)[row, shifted // 64]
    brick = np.where(joint, 0.0, shade) * _patches(rng, 3.0, 200.0)
    mortar = np.where(joint, 0.9, 0.05) * _patches(rng, 3.0, 100.0)
    stain = contrast(fractal(rng, _SIZE, 8, 300, 0.8) - 1.3, 5.0)
    return _stack(brick * (1 - stain), mortar * (1 - stain), 0.3 * stain, stain)


def plaster_detail(rng: np.random.Generator) -> Image:
    """Plaster with flaked patches, stains and splashes."""
    plaster = 0.55 + 0.12 * fractal(rng, _SIZE, 3, 90, 0.6)
    flaked = contrast(fractal(rng, _SIZE, 6, 220, 0.8) - 0.9, 9.0)
    splash = np.zeros((_SIZE, _SIZE), np.float32)
    spots(splash, rng, 375, (1.5, 16), (0.1, 0.9))
    strokes(splash, rng, 65, (20, 160), (0.3, 0.9))
    ochre = contrast(fractal(rng, _SIZE, 60, 300, 0.8) - 0.6, 4.0)
    keep = (1.0 - flaked) * (1.0 - splash)
    return _stack(plaster * keep * (1.0 - ochre), plaster * keep * ochre, 0.8 * splash, flaked * _patches(rng) * 0.7)


def plank_detail(rng: np.random.Generator) -> Image:
    """Boards along u with grain, knots, and flakes of blue and red paint."""
    board = np.repeat(rng.uniform(0.35, 1.0, _SIZE // 32), 32).astype(np.float32)[:, None]
    gap = (np.arange(_SIZE) % 32 < 2)[:, None]
    grain = np.full((_SIZE, _SIZE), 0.6, np.float32)
    strokes(grain, rng, 875, (40, 200), (0.2, 1.0), 0.03)
    spots(grain, rng, 125, (2, 9), (0.02, 0.3))
    wood = np.where(gap, 0.05, board * grain)
    blue = contrast(fractal(rng, _SIZE, 5, 260, 0.8) - 0.9, 9.0)
    red = contrast(fractal(rng, _SIZE, 5, 260, 0.8) - 1.2, 9.0) * (1.0 - blue)
    bare = 1.0 - blue - red
    return _stack(wood * bare, 0.6 * (1 - grain) * bare, blue * board, red * board)


def rock_detail(rng: np.random.Generator) -> Image:
    """Grey stone with lichen and dirt."""
    stone = 0.5 + 0.18 * fractal(rng, _SIZE, 3, 200, 0.8)
    lichen = np.zeros((_SIZE, _SIZE), np.float32)
    spots(lichen, rng, 450, (2, 22), (0.1, 1.0))
    dirt = contrast(fractal(rng, _SIZE, 5, 120, 0.7) - 0.9, 6.0)
    keep = (1.0 - lichen) * (1.0 - dirt)
    return _stack(stone * keep, lichen, 0.5 * dirt, 0.15 * dirt)


def ground_map(rng: np.random.Generator, size: int, worn: Image) -> Image:
    """Where on the ground which of its four endmembers lies, (size, size, 4); ``worn`` (size, size) bares soil."""
    fields = [fractal(rng, size, 3, size / 8.0, 0.75) for _ in range(4)]
    fields[0] += 0.5 - 1.5 * worn
    fields[2] += 0.9 * worn - 0.2
    fields[3] -= 0.5 - 0.5 * worn
    share = np.exp(3.0 * np.stack(fields, axis=-1))
    share /= share.sum(axis=-1, keepdims=True)
    litter = 0.62 + 0.16 * fractal(rng, size, 2, size / 16.0, 0.5)
    spots(litter, rng, 26000, (0.8, 7.0), (0.3, 0.95))
    return np.asarray(np.clip(share * litter[..., None], 0.0, 1.0).astype(np.float32))


DETAILS = {
    "ground": ground_detail,
    "bark": bark_detail,
    "foliage": foliage_detail,
    "brick": brick_detail,
    "plaster": plaster_detail,
    "planks": plank_detail,
    "fittings": plank_detail,
    "rock": rock_detail,
}
"""How the detail of each material of :data:`~services.sensors.world.spectra.MATERIALS` is drawn."""


def sky_clouds(rng: np.random.Generator, cover: float) -> Image:
    """Density (512, 512) in 0..1 of clouds that tile, over a part ``cover`` of the sky."""
    field = fractal(rng, 512, 24, 256, 1.3)
    return contrast(field - np.float32(np.quantile(field, 1.0 - np.clip(cover, 0.0, 1.0))), 2.2)
