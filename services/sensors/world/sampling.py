"""Filtered look-ups in textures, shadow maps and light charts, along spans of a row of pixels; compiled.

Texels are fetched with all four lanes in one 64-bit word, 16 bits a lane, so that one multiplication
interpolates four weights; light likewise with two lanes of 32 bits. Coordinates are in 1/256 texel.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from common.geometry import Array
from services.sensors.world.kernel import kernel

Footprint = tuple[float, float, float, float, float]

STRIDE = 4
"""How far apart pixels may be whose words :func:`spread_out` interpolates."""
U16, U32, U48 = np.uint64(16), np.uint64(32), np.uint64(48)
LOW16, LOW32 = np.uint64(0xFFFF), np.uint64(0xFFFFFFFF)
QUARTER_OF_16, QUARTER_OF_32 = np.uint64(0x3FFF3FFF3FFF3FFF), np.uint64(0x3FFFFFFF3FFFFFFF)
TEXEL_UNIT = 1.0 / 65280.0
"""What one is in a lane of :func:`filtered`."""
LIGHT_UNIT = 1.0 / (65535.0 * 65536.0)
"""What one is in a half of :func:`ground_light` and :func:`chart_light`."""
_EVEN_LANES, _ODD_LANES, _LANES = np.uint64(0x00FF00FF), np.uint64(0xFF00FF00), np.uint64(0x00FF00FF00FF00FF)
_U2, _U4, _U8, _U24, _ONE = np.uint64(2), np.uint64(4), np.uint64(8), np.uint64(24), np.uint64(256)
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


@kernel
def footprint_at(lines: Array, first: int, u: float, v: float) -> Footprint:
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
def places_along(lines: Array, first: int, u: float, v: float, stride: int, count: int, xy: NDArray[np.int64]) -> None:
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
def filtered(
    texels: NDArray[np.uint32], start: int, log: int, footprint: Footprint, xy: NDArray[np.int64],
    count: int, out: NDArray[np.uint64],
) -> None:  # fmt: skip
    """The four lanes of a texture over each pixel's footprint, 65280 for full, in the order 0, 2, 1, 3.

    Several samples along the footprint's length keep ground sharp that is seen at a grazing angle (Heckbert,
    *Survey of Texture Mapping*, 1986). All is in squared lengths and in fixed point of 1/256 texel, for this is
    the renderer's innermost loop.
    """
    major, minor, step_s, step_t, _ = footprint
    initial = np.uint64(0)
    if major > _FLAT * _FLAT:
        initial = _spread(texels[start + (_FOURS & ((1 << 2 * (log + 1)) - 4))]) << _U8
    # Slices are assigned by a slow general routine: most spans are a few pixels of a leaf.
    for i in range(count):
        out[i] = initial
    if major > _FLAT * _FLAT:
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
    if slender > 16.0 and major < _COARSE * _COARSE:
        halvings, shrink = 2, 1.0 / 16.0
    elif slender > 4.0 and major < _COARSE * _COARSE:
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
def spread_out(words: NDArray[np.uint64], count: int, quarters: np.uint64) -> None:
    """Interpolate words of every fourth pixel to all ``count``, in place; ``quarters`` masks a quarter of each lane."""
    for i in range(count - 1, -1, -1):
        part = np.uint64(i & 3)
        before, after = words[i >> 2] >> _U2 & quarters, words[(i >> 2) + 1] >> _U2 & quarters
        words[i] = before * (_U4 - part) + after * part


@kernel
def ground_light(
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
def chart_light(
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
def _blend(light: NDArray[np.uint32], upper: int, lower: int, left: int, right: int, x: int, y: int) -> np.uint64:
    """Between four samples, at x, y in 0..256: sun in the low half of the word, sky in the high one."""
    a, b = halves(light[np.uint64(upper + left)]), halves(light[np.uint64(upper + right)])
    c, d = halves(light[np.uint64(lower + left)]), halves(light[np.uint64(lower + right)])
    top = a * np.uint64((256 - x) * (256 - y)) + b * np.uint64(x * (256 - y))
    return top + c * np.uint64((256 - x) * y) + d * np.uint64(x * y)


@kernel
def halves(sample: np.uint32) -> np.uint64:
    """Two 16-bit numbers, each at the low end of half a word."""
    word = np.uint64(sample)
    return (word & LOW16) | (word >> U16) << U32
