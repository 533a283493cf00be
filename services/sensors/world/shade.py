"""The light that each pixel receives: filtered textures under sun and sky, compiled.

Texels are fetched with all four lanes in one 64-bit word, 16 bits a lane, so that one multiplication
interpolates four weights.
"""

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
from services.sensors.world.spectra import MATERIAL_INDEX

GROUND = MATERIAL_INDEX["ground"]

_EVEN_LANES = np.uint64(0x00FF00FF)
_ODD_LANES = np.uint64(0xFF00FF00)
_LANES = np.uint64(0x00FF00FF00FF00FF)
_U8, _U24, _U16, _U32, _U48 = np.uint64(8), np.uint64(24), np.uint64(16), np.uint64(32), np.uint64(48)
_ONE = np.uint64(256)
_LOW32 = np.uint64(0xFFFFFFFF)
_LOW16 = np.uint64(0xFFFF)
SPAN = 32
"""Most pixels that are shaded at once."""
SCRATCH = SPAN + 4
Footprint = tuple[float, float, float, float, float]
_STRIDE = 4
_MAGNIFIED = 0.2
"""Texels from one pixel to the next below which the ground's map is read at every fourth pixel only."""
_QUARTER_OF_16, _QUARTER_OF_32 = np.uint64(0x3FFF3FFF3FFF3FFF), np.uint64(0x3FFFFFFF3FFFFFFF)
_U2, _U4 = np.uint64(2), np.uint64(4)
_SKY_STEP = 8
_FARTHEST = 1e-5
"""Inverse depth, 1/m, below which a surface is not followed."""
_COARSE = 64.0
"""Texels in a footprint's length from which it is read as if it were square."""
_FLAT = 256.0
"""Texels in a footprint's length from which a texture is as good as its mean."""
_LEVEL_BLEND = 24
"""Of 256: below this share the other mip level is not looked up."""
_FOURS = 0x1555555555555555
"""1 + 4 + 16 + ...: masked, the sum of the sizes of successive mip levels."""
_PER_LIGHT = 1.0 / (65535.0 * 65536.0)
_TO_UNIT = 1.0 / 65280.0


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
    footprint = _footprint(lines, 3, u + 0.5 * (count - 1), v)
    _texture_places(lines, 3, u, v, 1, count, xy)
    _filtered(texels, starts[texture], logs[texture], footprint, xy, count, words[0])
    if material == GROUND:
        last = len(starts) - 1
        footprint = _footprint(lines, 9, u + 0.5 * (count - 1), v)
        stride = _STRIDE if footprint[4] < _MAGNIFIED * _MAGNIFIED else 1
        places = (count - 1) // stride + (2 if stride > 1 else 1)
        _texture_places(lines, 9, u, v, stride, places, xy)
        _filtered(texels, starts[last], logs[last], footprint, xy, places, words[1])
        if width == 0:
            _ground_light(light_ground, logs[last], footprint, xy, places, words[2])
        if stride > 1:
            _spread_out(words[1], count, _QUARTER_OF_16)
            _spread_out(words[2], count, _QUARTER_OF_32)
    if width == 1:
        words[2, :count] = _halves(light_charts[indices[name, CHART_START]]) << _U16
    elif width > 1:
        _texture_places(lines, 9, u, v, 1, count, xy)
        _chart_light(light_charts, indices[name, CHART_START], width, indices[name, CHART_HEIGHT], xy, count, words[2])
    _colour(words, count, 2 if material == GROUND else 1, share, weights[name], sun[material], sky[material], out)


@kernel
def _footprint(lines: Array, first: int, u: float, v: float) -> Footprint:
    """The extent of a pixel on a surface whose coordinates are the functions ``first`` and ``first + 3`` of a polygon.

    Returns its squared length and breadth, the two coordinates' steps along its length, and the square of what one
    pixel to the right is. A coordinate is s = N z
    with N and 1/z linear in u and v, so that ds/du = (dN/du - s d(1/z)/du) z.
    """
    a, b = lines[0], lines[1]
    z = 1.0 / max(a * u + b * v + lines[2], _FARTHEST)
    s = (lines[first] * u + lines[first + 1] * v + lines[first + 2]) * z
    t = (lines[first + 3] * u + lines[first + 4] * v + lines[first + 5]) * z
    su, sv = (lines[first] - s * a) * z, (lines[first + 1] - s * b) * z
    tu, tv = (lines[first + 3] - t * a) * z, (lines[first + 4] - t * b) * z
    along, down = su * su + tu * tu, sv * sv + tv * tv
    if along > down:
        return along, down, su, tu, along
    return down, along, sv, tv, along


@kernel
def _texture_places(
    lines: Array, first: int, u: float, v: float, stride: int, count: int, xy: NDArray[np.int64]
) -> None:
    """Both coordinates (2, count) of every ``stride``-th pixel of a span, in 1/256."""
    d0, d1 = lines[1] * v + lines[2], lines[0]
    s0, s1 = (lines[first + 1] * v + lines[first + 2]) * 256.0, lines[first] * 256.0
    t0, t1 = (lines[first + 4] * v + lines[first + 5]) * 256.0, lines[first + 3] * 256.0
    for i in range(count):
        at = u + i * stride
        z = 1.0 / max(d0 + d1 * at, _FARTHEST)
        xy[0, i] = int((s0 + s1 * at) * z)
        xy[1, i] = int((t0 + t1 * at) * z)


@kernel
def _spread_out(words: NDArray[np.uint64], count: int, quarters: np.uint64) -> None:
    """Interpolate words of every fourth pixel to all ``count``, in place; ``quarters`` masks a quarter of each lane."""
    for i in range(count - 1, -1, -1):
        part = np.uint64(i & 3)
        before, after = words[i >> 2] >> _U2 & quarters, words[(i >> 2) + 1] >> _U2 & quarters
        words[i] = before * (_U4 - part) + after * part


@kernel
def _colour(
    words: NDArray[np.uint64],
    count: int,
    is_ground: bool,
    share: float,
    weight: Array,
    sun: Array,
    sky: Array,
    out: Floats,
) -> None:
    """Add the light of a span: endmembers mixed by the lanes of one or two textures, under sun and sky."""
    scale = share * _TO_UNIT * _PER_LIGHT * (_TO_UNIT if textures == 2 else 1.0)
    w0, w1, w2, w3 = weight[0] * scale, weight[1] * scale, weight[2] * scale, weight[3] * scale
    for i in range(count):
        word, light = words[0, i], words[2, i]
        m0, m1 = w0 * np.int64(word & _LOW16), w1 * np.int64(word >> _U32 & _LOW16)
        m2, m3 = w2 * np.int64(word >> _U16 & _LOW16), w3 * np.int64(word >> _U48)
        if textures == 2:
            word = words[1, i]
            m0, m1 = m0 * np.int64(word & _LOW16), m1 * np.int64(word >> _U32 & _LOW16)
            m2, m3 = m2 * np.int64(word >> _U16 & _LOW16), m3 * np.int64(word >> _U48)
        sunlit, skylit = float(np.int64(light & _LOW32)), float(np.int64(light >> _U32))
        for band in range(3):
            in_sun = m0 * sun[0, band] + m1 * sun[1, band] + m2 * sun[2, band] + m3 * sun[3, band]
            in_sky = m0 * sky[0, band] + m1 * sky[1, band] + m2 * sky[2, band] + m3 * sky[3, band]
            out[i, band] += sunlit * in_sun + skylit * in_sky


@kernel
def _filtered(
    texels: NDArray[np.uint32], start: int, log: int, footprint: Footprint, xy: NDArray[np.int64],
    count: int, out: NDArray[np.uint64],
) -> None:  # fmt: skip
    """The four lanes of a texture over each pixel's footprint, 65280 for full, in the order 0, 2, 1, 3.

    Several samples along the footprint's length keep ground sharp that is seen at a grazing angle (Heckbert,
    *Survey of Texture Mapping*, 1986). All is in squared lengths and in fixed point of 1/256 texel, for this is
    the renderer's innermost loop.
    """
    major, minor, step_s, step_t, _ = footprint
    out[:count] = np.uint64(0)
    if major > _FLAT * _FLAT:
        out[:count] = _spread(texels[start + (_FOURS & ((1 << 2 * (log + 1)) - 4))]) << _U8
        return
    halvings, level, coarse = _probes(major, minor, log)
    if halvings == 0:
        if coarse < 256 - _LEVEL_BLEND:
            weight = 256 if coarse < _LEVEL_BLEND else 256 - coarse
            _add_texels(texels, start, log, level, xy, 0, 0, weight, count, out)
        if coarse >= _LEVEL_BLEND:
            weight = coarse if coarse < 256 - _LEVEL_BLEND else 256
            _add_texels(texels, start, log, level + 1, xy, 0, 0, weight, count, out)
        return
    # With several probes the two mip levels are blended by sharing the probes between them.
    probes = 1 << halvings
    step_x, step_y = int(step_s * 256.0) >> halvings, int(step_t * 256.0) >> halvings
    x, y = -(step_x * (probes - 1) >> 1), -(step_y * (probes - 1) >> 1)
    from_coarse = (coarse * probes + 128) >> 8
    for k in range(probes):
        _add_texels(texels, start, log, level + (1 if k < from_coarse else 0), xy, x, y, 256 >> halvings, count, out)
        x += step_x
        y += step_y


@kernel
def _probes(major: float, minor: float, log: int) -> tuple[int, int, int]:
    """How to filter a footprint of squared length and breadth.

    Returns the binary logarithm of the number of probes along it, the finer of two mip levels, and the coarser
    level's share, of 256.
    """
    halvings, shrink = 0, 1.0
    # Probes closer together than a texel would read the same texels twice.
    slender = min(major, major / max(minor, 1e-9))
    if slender > 9.0 and major < _COARSE * _COARSE:
        halvings, shrink = 2, 1.0 / 16.0
    elif slender > 2.25 and major < _COARSE * _COARSE:
        halvings, shrink = 1, 0.25
    bits = np.float64(max(minor, major * shrink, 1.0)).view(np.int64)
    # Half of the binary exponent of the squared width; the rest of it is then between 1 and 4.
    level = min(int(bits >> 52) - 1023 >> 1, log - 3)
    width = np.int64(bits - (level << 53)).view(np.float64)
    # Linear in the squared width, from 0 where a texel is a pixel to 256 where two are.
    return halvings, level, int(min((width - 1.0) * (256.0 / 3.0), 256.0))


@kernel
def _add_texels(
    texels: NDArray[np.uint32], start: int, log: int, level: int, xy: NDArray[np.int64], dx: int, dy: int, weight: int,
    count: int, out: NDArray[np.uint64],
) -> None:  # fmt: skip
    """Add ``weight``, of 256, times bilinear samples of a mip level, shifted by (dx, dy) in 1/256 texel of level 0."""
    bits = log - level
    last = (1 << bits) - 1
    # The levels before this one hold 4^log + 4^(log-1) + ... texels.
    base = start + (_FOURS & ((1 << 2 * (log + 1)) - (1 << 2 * (bits + 1))))
    part = np.uint64(weight)
    for i in range(count):
        x, y = ((xy[0, i] + dx) >> level) - 128, ((xy[1, i] + dy) >> level) - 128
        fx, fy = np.uint64(x & 255), np.uint64(y & 255)
        left, right = _tile_column(x >> 8 & last), _tile_column(((x >> 8) + 1) & last)
        upper, lower = base + _tile_row(y >> 8 & last, bits), base + _tile_row(((y >> 8) + 1) & last, bits)
        gx, gy = _ONE - fx, _ONE - fy
        # An unsigned index spares the test whether it counts from the end.
        a, b = _spread(texels[np.uint64(upper + left)]), _spread(texels[np.uint64(upper + right)])
        c, d = _spread(texels[np.uint64(lower + left)]), _spread(texels[np.uint64(lower + right)])
        above = (a * gx + b * fx) >> _U8 & _LANES
        below = (c * gx + d * fx) >> _U8 & _LANES
        out[i] += ((above * gy + below * fy) >> _U8 & _LANES) * part


@kernel
def _tile_column(x: int) -> int:
    """The part of a texel's index that its column makes: images are kept in tiles of 4x4, one to a line of cache."""
    return (x >> 2) << 4 | (x & 3)


@kernel
def _tile_row(y: int, bits: int) -> int:
    """The part of a texel's index that its row makes, in an image of side 2^bits."""
    return (y >> 2) << (bits + 2) | (y & 3) << 2


@kernel
def _spread(texel: np.uint32) -> np.uint64:
    """Four bytes as four 16-bit lanes, in the order 0, 2, 1, 3."""
    word = np.uint64(texel)
    return (word & _EVEN_LANES) | (word & _ODD_LANES) << _U24


@kernel
def _halves(sample: np.uint32) -> np.uint64:
    """Two 16-bit numbers, each at the low end of half a word."""
    word = np.uint64(sample)
    return (word & _LOW16) | (word >> _U16) << _U32


@kernel
def _blend(light: NDArray[np.uint32], upper: int, lower: int, left: int, right: int, x: int, y: int) -> np.uint64:
    """Between four samples, at x, y in 0..256: sun in the low half of the word, sky in the high one."""
    a, b = _halves(light[np.uint64(upper + left)]), _halves(light[np.uint64(upper + right)])
    c, d = _halves(light[np.uint64(lower + left)]), _halves(light[np.uint64(lower + right)])
    top = a * np.uint64((256 - x) * (256 - y)) + b * np.uint64(x * (256 - y))
    return top + c * np.uint64((256 - x) * y) + d * np.uint64(x * y)


@kernel
def _ground_light(
    light: NDArray[np.uint32], log: int, footprint: Footprint, xy: NDArray[np.int64], count: int,
    out: NDArray[np.uint64],
) -> None:  # fmt: skip
    """Sun and sky on the ground along a span, whose places ``xy`` are in 1/256 texel of the shadow map's level 0."""
    breadth, level = footprint[1], 0
    while breadth >= 1.0 and level < log - 4:
        breadth *= 0.25
        level += 1
    bits = log - level
    most = (1 << bits) - 1
    base = _FOURS & ((1 << 2 * (log + 1)) - (1 << 2 * (bits + 1)))
    for i in range(count):
        x, y = (xy[0, i] >> level) - 128, (xy[1, i] >> level) - 128
        left, upper = min(max(x >> 8, 0), most), min(max(y >> 8, 0), most)
        right, lower = min(max((x >> 8) + 1, 0), most), min(max((y >> 8) + 1, 0), most)
        upper, lower = base + _tile_row(upper, bits), base + _tile_row(lower, bits)
        out[i] = _blend(light, upper, lower, _tile_column(left), _tile_column(right), x & 255, y & 255)


@kernel
def _chart_light(
    light: NDArray[np.uint32],
    start: int,
    width: int,
    height: int,
    xy: NDArray[np.int64],
    count: int,
    out: NDArray[np.uint64],
) -> None:
    """Sun and sky along a span on a chart, whose samples lie at whole numbers."""
    for i in range(count):
        x = min(max(xy[0, i], 0), (width - 1) * 256 - 1)
        y = min(max(xy[1, i], 0), (height - 1) * 256 - 1)
        upper = start + (y >> 8) * width
        out[i] = _blend(light, upper, upper + width, x >> 8, (x >> 8) + 1, x & 255, y & 255)


@kernel
def _heaven(rx: float, ry: float, R: Array, backdrop: Floats, cloud: Floats) -> tuple[float, float, float]:
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
