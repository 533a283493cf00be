"""The light that each pixel receives: what it shows, mixed of endmembers, under sun and sky; compiled."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from common.geometry import Array
from services.sensors.world.geometry import (
    CHART_HEIGHT,
    CHART_START,
    CHART_WIDTH,
    MATERIAL,
    TEXTURE,
    Floats,
)
from services.sensors.world.kernel import inlined, kernel
from services.sensors.world.sampling import (
    LIGHT_UNIT,
    LOW16,
    LOW32,
    QUARTER_OF_16,
    QUARTER_OF_32,
    STRIDE,
    TEXEL_UNIT,
    U16,
    U32,
    U48,
    chart_light,
    filtered,
    footprint_at,
    ground_light,
    halves,
    places_along,
    spread_out,
)
from services.sensors.world.spectra import MATERIAL_INDEX

GROUND = MATERIAL_INDEX["ground"]
SPAN = 32
"""Most pixels that are shaded at once."""
SCRATCH = SPAN + STRIDE
"""Width of the scratch arrays of :func:`shade`."""
_MAGNIFIED = 0.2
"""Texels from one pixel to the next below which the ground's map is read at every fourth pixel only."""
_SKY_STEP = 8


@kernel
def shade(
    polygon: NDArray[np.int32],
    screen: Array,
    samples: int,
    weights: Array,
    indices: NDArray[np.int64],
    texels: NDArray[np.uint32],
    starts: NDArray[np.int64],
    logs: NDArray[np.int64],
    light_ground: NDArray[np.uint32],
    light_charts: NDArray[np.uint32],
    sun: Array,
    sky: Array,
    backdrop: Array,
    cloud: Floats,
    R_world_camera: Array,
    intrinsics: Array,
    scratch_integers: NDArray[np.int64],
    scratch_lanes: NDArray[np.uint64],
    image: Floats,
) -> None:
    """Write the light (H, W, 3) that red, green and blue receive.

    ``polygon`` and ``screen`` are those of :func:`~services.sensors.world.raster.rasterise`; ``sun`` and ``sky``
    (M, 4, 3) what each band sees of each endmember in full sunlight and under the whole sky; ``backdrop`` (3, 3)
    the sky's light at the horizon, at the zenith, and of clouds; ``cloud`` (S, S) the clouds' density.
    ``scratch_integers`` (2, :data:`SCRATCH`) and ``scratch_lanes`` (3, :data:`SCRATCH`) are overwritten.
    """
    rows, columns = image.shape[0], image.shape[1]
    for row in range(rows):
        image[row] = 0.0
        column = 0
        while column < columns:
            id0, id1, id2, id3 = _samples_of(polygon, samples, row, column)
            if id0 == id1 and id0 == id2 and id0 == id3:
                end = column + 1
                most = min(columns, column + SPAN)
                while end < most and _is_all(polygon, samples, row, end, id0):
                    end += 1
                _span(
                    id0, float(column), float(row), end - column, 1.0, screen, weights, indices, texels, starts, logs,
                    light_ground, light_charts, sun, sky, backdrop, cloud, R_world_camera, intrinsics,
                    scratch_integers, scratch_lanes, image[row, column:end],
                )  # fmt: skip
                column = end
                continue
            done = 0
            for first in range(4):
                if done >> first & 1:
                    continue
                name = _pick(id0, id1, id2, id3, first)
                count, right, down = 0, 0, 0
                for k in range(first, 4):
                    if _pick(id0, id1, id2, id3, k) == name:
                        done |= 1 << k
                        count, right, down = count + 1, right + (k & 1), down + (k >> 1)
                # The light is taken where the polygon's samples lie in the mean, so that it is on the polygon.
                u, v = column + 0.5 * right / count - 0.25, row + 0.5 * down / count - 0.25
                _span(
                    name, u, v, 1, 0.25 * count, screen, weights, indices, texels, starts, logs,
                    light_ground, light_charts, sun, sky, backdrop, cloud, R_world_camera, intrinsics,
                    scratch_integers, scratch_lanes, image[row, column : column + 1],
                )  # fmt: skip
            column += 1


@inlined
def _samples_of(polygon: NDArray[np.int32], samples: int, row: int, column: int) -> tuple[int, int, int, int]:
    """The polygons of a pixel's four samples, or of its one, four times."""
    if samples == 2:
        r, c = 2 * row, 2 * column
        return polygon[r, c], polygon[r, c + 1], polygon[r + 1, c], polygon[r + 1, c + 1]
    only = polygon[row, column]
    return only, only, only, only


@inlined
def _is_all(polygon: NDArray[np.int32], samples: int, row: int, column: int, name: int) -> bool:
    """Whether a pixel shows one polygon alone."""
    a, b, c, d = _samples_of(polygon, samples, row, column)
    return bool(a == name and b == name and c == name and d == name)


@kernel
def _pick(a: int, b: int, c: int, d: int, k: int) -> int:
    """The k-th of four."""
    low, high = (b if k & 1 else a), (d if k & 1 else c)
    return high if k & 2 else low


@inlined
def _span(
    name: int, u: float, v: float, count: int, share: float, screen: Array, weights: Array, indices: NDArray[np.int64],
    texels: NDArray[np.uint32], starts: NDArray[np.int64], logs: NDArray[np.int64], light_ground: NDArray[np.uint32],
    light_charts: NDArray[np.uint32], sun: Array, sky: Array, backdrop: Array, cloud: Floats, R: Array,
    intrinsics: Array, xy: NDArray[np.int64], words: NDArray[np.uint64], out: Floats,
) -> None:  # fmt: skip
    """Add ``share`` of the light at ``count`` pixels from (u, v) rightwards, which all show polygon ``name``.

    A span shares one mip level, that of its middle: what varies from pixel to pixel is left in tight loops.
    """
    if name < 0:
        ry = (v - intrinsics[3]) / intrinsics[1]
        r1, g1, b1 = _heaven((u - intrinsics[2]) / intrinsics[0], ry, R, backdrop, cloud)
        for start in range(0, count, _SKY_STEP):
            # The sky has no detail finer than this, and is linear in between.
            r0, g0, b0 = r1, g1, b1
            r1, g1, b1 = _heaven((u + start + _SKY_STEP - intrinsics[2]) / intrinsics[0], ry, R, backdrop, cloud)
            for i in range(start, min(start + _SKY_STEP, count)):
                f = (i - start) / _SKY_STEP
                out[i, 0] += share * (r0 + f * (r1 - r0))
                out[i, 1] += share * (g0 + f * (g1 - g0))
                out[i, 2] += share * (b0 + f * (b1 - b0))
        return
    lines = screen[name]
    texture, material, width = indices[name, TEXTURE], indices[name, MATERIAL], indices[name, CHART_WIDTH]
    footprint = footprint_at(lines, 3, u + 0.5 * (count - 1), v)
    places_along(lines, 3, u, v, 1, count, xy)
    filtered(texels, starts[texture], logs[texture], footprint, xy, count, words[0])
    if material == GROUND:
        last = len(starts) - 1
        footprint = footprint_at(lines, 9, u + 0.5 * (count - 1), v)
        stride = STRIDE if footprint[4] < _MAGNIFIED * _MAGNIFIED else 1
        places = (count - 1) // stride + (2 if stride > 1 else 1)
        places_along(lines, 9, u, v, stride, places, xy)
        filtered(texels, starts[last], logs[last], footprint, xy, places, words[1])
        if width == 0:
            ground_light(light_ground, logs[last], footprint, xy, places, words[2])
        if stride > 1:
            spread_out(words[1], count, QUARTER_OF_16)
            spread_out(words[2], count, QUARTER_OF_32)
    if width == 1:
        evenly = halves(light_charts[indices[name, CHART_START]]) << U16
        for i in range(count):
            words[2, i] = evenly
    elif width > 1:
        places_along(lines, 9, u, v, 1, count, xy)
        chart_light(light_charts, indices[name, CHART_START], width, indices[name, CHART_HEIGHT], xy, count, words[2])
    _colour(words, count, 2 if material == GROUND else 1, share, weights[name], sun[material], sky[material], out)


@kernel
def _colour(
    words: NDArray[np.uint64],
    count: int,
    textures: int,
    share: float,
    weight: Array,
    sun: Array,
    sky: Array,
    out: Floats,
) -> None:
    """Add the light of a span: endmembers mixed by the lanes of one or two textures, under sun and sky."""
    scale = share * TEXEL_UNIT * LIGHT_UNIT * (TEXEL_UNIT if textures == 2 else 1.0)
    w0, w1, w2, w3 = weight[0] * scale, weight[1] * scale, weight[2] * scale, weight[3] * scale
    for i in range(count):
        word, light = words[0, i], words[2, i]
        m0, m1 = w0 * np.int64(word & LOW16), w1 * np.int64(word >> U32 & LOW16)
        m2, m3 = w2 * np.int64(word >> U16 & LOW16), w3 * np.int64(word >> U48)
        if textures == 2:
            word = words[1, i]
            m0, m1 = m0 * np.int64(word & LOW16), m1 * np.int64(word >> U32 & LOW16)
            m2, m3 = m2 * np.int64(word >> U16 & LOW16), m3 * np.int64(word >> U48)
        sunlit, skylit = float(np.int64(light & LOW32)), float(np.int64(light >> U32))
        for band in range(3):
            in_sun = m0 * sun[0, band] + m1 * sun[1, band] + m2 * sun[2, band] + m3 * sun[3, band]
            in_sky = m0 * sky[0, band] + m1 * sky[1, band] + m2 * sky[2, band] + m3 * sky[3, band]
            out[i, band] += sunlit * in_sun + skylit * in_sky


@kernel
def _heaven(rx: float, ry: float, R: Array, backdrop: Array, cloud: Floats) -> tuple[float, float, float]:
    """The sky along ray (rx, ry, 1): from horizon to zenith, with clouds on a plane far above."""
    dx = R[0, 0] * rx + R[0, 1] * ry + R[0, 2]
    dy = R[1, 0] * rx + R[1, 1] * ry + R[1, 2]
    dz = R[2, 0] * rx + R[2, 1] * ry + R[2, 2]
    up = max(dz / np.sqrt(dx * dx + dy * dy + dz * dz), 0.0)
    haze = (1.0 - up) * (1.0 - up)
    haze *= haze
    size = len(cloud)
    reach = 160.0 / (dz + 0.15 * np.sqrt(dx * dx + dy * dy)) if dz > 0.0 else 0.0
    s, t = dx * reach, dy * reach
    i, j = int(np.floor(s)), int(np.floor(t))
    fs, ft = s - i, t - j
    mask = size - 1
    upper = cloud[j & mask, i & mask] * (1.0 - fs) + cloud[j & mask, (i + 1) & mask] * fs
    lower = cloud[(j + 1) & mask, i & mask] * (1.0 - fs) + cloud[(j + 1) & mask, (i + 1) & mask] * fs
    # Towards the horizon the plane's texture would alias; there the clouds dissolve into haze.
    density = (upper * (1.0 - ft) + lower * ft) * (1.0 - haze)
    keep_horizon, keep_zenith = haze * (1.0 - density), (1.0 - haze) * (1.0 - density)
    return (
        backdrop[0, 0] * keep_horizon + backdrop[1, 0] * keep_zenith + backdrop[2, 0] * density,
        backdrop[0, 1] * keep_horizon + backdrop[1, 1] * keep_zenith + backdrop[2, 1] * density,
        backdrop[0, 2] * keep_horizon + backdrop[1, 2] * keep_zenith + backdrop[2, 2] * density,
    )
