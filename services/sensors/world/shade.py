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
    LEVEL_BLEND,
    LIGHT_UNIT,
    LOW16,
    STRIDE,
    TEXEL_UNIT,
    Footprint,
    Places,
    Words,
    chart_light,
    filtered,
    footprint_at,
    ground_light,
    level_start,
    padded,
    places_along,
    probes_of,
    spread_out,
    texel_at,
)
from services.sensors.world.spectra import MATERIAL_INDEX

GROUND = MATERIAL_INDEX["ground"]
SPAN = 32
"""Most pixels that are shaded at once."""
SCRATCH = SPAN + 2 * STRIDE
"""Width of the scratch arrays of :func:`shade`."""
_MAGNIFIED = 0.2
"""Texels from one pixel to the next below which the ground's map is read at every fourth pixel only."""
_SKY_STEP = 8
_FEW = 8
"""Pixels up to which a span of an evenly lit polygon is not worth the way that goes by eights."""
WORDS = 12
"""Rows of the scratch words: 4 texels, 2 of detail, 2 of the ground's map, 1 of light; 2 and 1 of every fourth."""
_FULL = np.uint32(0xFF00FF00)
_U16 = np.uint64(0xFFFF)


@kernel
def shade(
    polygon: NDArray[np.int32],
    screen: Floats,
    samples: int,
    weights: Array,
    indices: NDArray[np.int64],
    evenly: Floats,
    texels: Words,
    starts: NDArray[np.int64],
    logs: NDArray[np.int64],
    light_ground: Words,
    light_charts: Words,
    sun: Array,
    sky: Array,
    backdrop: Array,
    cloud: Floats,
    R_world_camera: Array,
    intrinsics: Array,
    places: Places,
    words: Words,
    bands: Floats,
    image: Floats,
) -> None:
    """Write the light (H, W, 3) that red, green and blue receive.

    ``polygon`` and ``screen`` are those of :func:`~services.sensors.world.raster.rasterise`; ``sun`` and ``sky``
    (M, 4, 3) what each band sees of each endmember in full sunlight and under the whole sky; ``backdrop`` (3, 3)
    the sky's light at the horizon, at the zenith, and of clouds; ``cloud`` (S, S) the clouds' density.
    ``evenly`` (N, 12) is what the bands receive of the four lanes of a polygon that is lit evenly. ``places``
    (2, :data:`SCRATCH`), ``words`` (:data:`WORDS`, :data:`SCRATCH`) and ``bands`` (3, :data:`SCRATCH`) are overwritten.
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
                    id0, float(column), float(row), end - column, 1.0, screen, weights, indices, evenly, texels, starts,
                    logs, light_ground, light_charts, sun, sky, backdrop, cloud, R_world_camera, intrinsics,
                    places, words, bands, image[row, column:end],
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
                    name, u, v, 1, 0.25 * count, screen, weights, indices, evenly, texels, starts,
                    logs, light_ground, light_charts, sun, sky, backdrop, cloud, R_world_camera, intrinsics,
                    places, words, bands, image[row, column : column + 1],
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
    name: int, u: float, v: float, count: int, share: float, screen: Floats, weights: Array, indices: NDArray[np.int64],
    evenly: Floats, texels: Words, starts: NDArray[np.int64], logs: NDArray[np.int64], light_ground: Words,
    light_charts: Words, sun: Array, sky: Array, backdrop: Array, cloud: Floats, R: Array,
    intrinsics: Array, xy: Places, words: Words, bands: Floats, out: Floats,
) -> None:  # fmt: skip
    """Add ``share`` of the light at ``count`` pixels from (u, v) rightwards, which all show polygon ``name``.

    A span shares one mip level, that of its middle: what varies from pixel to pixel is left in tight loops.
    """
    if name < 0:
        _sky(u, v, count, share, backdrop, cloud, R, intrinsics, out)
        return
    lines = screen[name]
    texture, material, width = indices[name, TEXTURE], indices[name, MATERIAL], indices[name, CHART_WIDTH]
    footprint = footprint_at(lines, 3, u + 0.5 * (count - 1), v)
    if width == 1 and material != GROUND and count <= _FEW:
        _leaf(texels, starts[texture], logs[texture], footprint, lines, u, v, count, share, evenly[name], out)
        return
    corners, detail, light = words[0:4], words[4:6], words[8]
    places_along(lines, 3, u, v, 1, count, xy)
    filtered(texels, starts[texture], logs[texture], footprint, xy, count, corners, detail)
    if material == GROUND:
        _ground(texels, starts, logs, light_ground, width, lines, u, v, count, xy, words)
    else:
        for i in range(count):
            words[6, i] = words[7, i] = _FULL
    if width == 1:
        everywhere = light_charts[indices[name, CHART_START]]
        for i in range(count):
            light[i] = everywhere
    elif width > 1:
        height = indices[name, CHART_HEIGHT]
        places_along(lines, 9, u, v, 1, count, xy)
        chart_light(light_charts, indices[name, CHART_START], width, height, xy, count, corners, light)
    _colour(words, count, share, weights[name], sun[material], sky[material], bands)
    for i in range(count):
        for band in range(3):
            out[i, band] += bands[band, i]


@kernel
def _sky(
    u: float, v: float, count: int, share: float, backdrop: Array, cloud: Floats, R: Array, intrinsics: Array,
    out: Floats,
) -> None:  # fmt: skip
    """Add the light of a span of sky."""
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


@kernel
def _ground(
    texels: Words, starts: NDArray[np.int64], logs: NDArray[np.int64], light: Words, width: int, lines: Floats,
    u: float, v: float, count: int, xy: Places, words: Words,
) -> None:  # fmt: skip
    """The ground's map along a span and, where it has one, its map of light."""
    last = len(starts) - 1
    footprint = footprint_at(lines, 9, u + 0.5 * (count - 1), v)
    corners = words[0:4]
    if footprint[4] < _MAGNIFIED * _MAGNIFIED:
        places = (count - 1) // STRIDE + 2
        places_along(lines, 9, u, v, STRIDE, places, xy)
        filtered(texels, starts[last], logs[last], footprint, xy, places, corners, words[9:11])
        if width == 0:
            ground_light(light, logs[last], footprint, xy, places, corners, words[11])
        spread_out(words[9], count, words[6])
        spread_out(words[10], count, words[7])
        spread_out(words[11], count, words[8])
        return
    places_along(lines, 9, u, v, 1, count, xy)
    filtered(texels, starts[last], logs[last], footprint, xy, count, corners, words[6:8])
    if width == 0:
        ground_light(light, logs[last], footprint, xy, count, corners, words[8])


@kernel
def _colour(words: Words, count: int, share: float, weight: Array, sun: Array, sky: Array, out: Floats) -> None:
    """The light (3, count) of a span: endmembers mixed by the lanes of detail and map, under sun and sky."""
    scale = share * TEXEL_UNIT * TEXEL_UNIT * LIGHT_UNIT
    w0, w1 = np.float32(weight[0] * scale), np.float32(weight[1] * scale)
    w2, w3 = np.float32(weight[2] * scale), np.float32(weight[3] * scale)
    for band in range(3):
        a0, a1 = w0 * np.float32(sun[0, band]), w1 * np.float32(sun[1, band])
        a2, a3 = w2 * np.float32(sun[2, band]), w3 * np.float32(sun[3, band])
        b0, b1 = w0 * np.float32(sky[0, band]), w1 * np.float32(sky[1, band])
        b2, b3 = w2 * np.float32(sky[2, band]), w3 * np.float32(sky[3, band])
        for i in range(padded(count)):
            m0, m2 = _low(words[4, i]) * _low(words[6, i]), _high(words[4, i]) * _high(words[6, i])
            m1, m3 = _low(words[5, i]) * _low(words[7, i]), _high(words[5, i]) * _high(words[7, i])
            in_sun, in_sky = a0 * m0 + a1 * m1 + a2 * m2 + a3 * m3, b0 * m0 + b1 * m1 + b2 * m2 + b3 * m3
            out[band, i] = _low(words[8, i]) * in_sun + _high(words[8, i]) * in_sky


@inlined
def _low(word: np.uint32) -> np.float32:
    """The low lane of a word."""
    return np.float32(np.int32(word & LOW16))


@inlined
def _high(word: np.uint32) -> np.float32:
    """The high lane of a word."""
    return np.float32(np.int32(np.uint32(word >> np.uint32(16))))


@kernel
def _leaf(
    texels: Words, start: int, log: int, footprint: Footprint, lines: Floats, u: float, v: float, count: int,
    share: float, colours: Floats, out: Floats,
) -> None:  # fmt: skip
    """Add the light of a few pixels of a polygon that is lit evenly; its texture is read as if seen head-on.

    A frame has thousands of such spans, of two or three pixels: all is in one loop, without scratch.
    """
    _, level, coarse = probes_of(footprint[0], footprint[0], log)
    level, coarse = (level + 1, 0) if coarse >= 256 - LEVEL_BLEND else (level, coarse if coarse >= LEVEL_BLEND else 0)
    fine_start, coarse_start = start + level_start(log, level), start + level_start(log, level + 1)
    part, rest = np.uint64(coarse), np.uint64(256 - coarse)
    unit = np.float32(share * TEXEL_UNIT)
    for i in range(count):
        at = u + i
        z = 256.0 / max(lines[0] * at + lines[1] * v + lines[2], 1e-5)
        x = int((lines[3] * at + lines[4] * v + lines[5]) * z)
        y = int((lines[6] * at + lines[7] * v + lines[8]) * z)
        word = texel_at(texels, fine_start, log - level, level, x, y) * rest
        if coarse:
            word += texel_at(texels, coarse_start, log - level - 1, level + 1, x, y) * part
        m0, m2 = np.float32(np.int64(word & _U16)) * unit, np.float32(np.int64(word >> np.uint64(16) & _U16)) * unit
        m1, m3 = (
            np.float32(np.int64(word >> np.uint64(32) & _U16)) * unit,
            np.float32(np.int64(word >> np.uint64(48))) * unit,
        )
        for band in range(3):
            out[i, band] += (
                m0 * colours[band] + m1 * colours[3 + band] + m2 * colours[6 + band] + m3 * colours[9 + band]
            )


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
