"""Filtered look-ups in textures, shadow maps and light charts, along spans of a row of pixels; compiled.

All loops but those that fetch from memory are in 32-bit integers and branch nowhere, so that they run eight pixels
at a time; spans are padded to whole eights. A texel's four lanes of 8 bits are handled as two words of two lanes of
16 bits: the even lanes 0 and 2, the odd lanes 1 and 3. Coordinates are in 1/256 texel.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from services.sensors.world.geometry import Floats
from services.sensors.world.kernel import inlined, kernel

Footprint = tuple[float, float, float, float, float]
Words = NDArray[np.uint32]
Places = NDArray[np.int32]

STRIDE = 4
"""How far apart pixels may be whose words :func:`spread_out` interpolates."""
TEXEL_UNIT = 1.0 / 65280.0
"""What one is in a lane of :func:`filtered`."""
LIGHT_UNIT = 1.0 / 65535.0
"""What one is in a sample of light."""
LANES = np.uint32(0x00FF00FF)
LOW16 = np.uint32(0xFFFF)
_EVEN_LANES, _ODD_LANES, _FOUR_LANES = np.uint64(0x00FF00FF), np.uint64(0xFF00FF00), np.uint64(0x00FF00FF00FF00FF)
_U8, _U24, _ONE = np.uint64(8), np.uint64(24), np.uint64(256)
_QUARTER = np.uint32(0x3FFF3FFF)
_FARTHEST = 1e-5
"""Inverse depth, 1/m, below which a surface is not followed."""
_COARSE = 64.0
"""Texels in a footprint's length from which it is read as if it were square."""
_FLAT = 256.0
"""Texels in a footprint's length from which a texture is as good as its mean."""
LEVEL_BLEND = 24
"""Of 256: below this share the other mip level is not looked up."""
_FOURS = 0x1555555555555555
"""1 + 4 + 16 + ...: masked, the sum of the sizes of successive mip levels."""


@kernel
def footprint_at(lines: Floats, first: int, u: float, v: float) -> Footprint:
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


@inlined
def padded(count: int) -> int:
    """The least multiple of eight that is not less."""
    return (count + 7) >> 3 << 3


@kernel
def places_along(lines: Floats, first: int, u: float, v: float, stride: int, count: int, xy: Places) -> None:
    """Both coordinates (2, count) of every ``stride``-th pixel of a span, in 1/256."""
    d0, d1 = lines[1] * v + lines[2] + lines[0] * u, lines[0] * float(stride)
    s0, s1 = (lines[first + 1] * v + lines[first + 2] + lines[first] * u) * 256.0, lines[first] * 256.0 * stride
    t0, t1 = (lines[first + 4] * v + lines[first + 5] + lines[first + 3] * u) * 256.0, lines[first + 3] * 256.0 * stride
    for i in range(padded(count)):
        at = float(np.int32(i))
        z = 1.0 / max(d0 + d1 * at, _FARTHEST)
        xy[0, i] = np.int32((s0 + s1 * at) * z)
        xy[1, i] = np.int32((t0 + t1 * at) * z)


@kernel
def filtered(
    texels: Words, start: int, log: int, footprint: Footprint, xy: Places, count: int, corners: Words, out: Words
) -> None:
    """A texture over each pixel's footprint: even and odd lanes (2, count), 65280 for full.

    Several samples along the footprint's length keep ground sharp that is seen at a grazing angle (Heckbert,
    *Survey of Texture Mapping*, 1986). All is in squared lengths and in fixed point of 1/256 texel, for this is
    the renderer's innermost loop. ``corners`` (4, count) is overwritten.
    """
    major, minor, step_s, step_t, _ = footprint
    flat = major > _FLAT * _FLAT
    mean = texels[start + (_FOURS & ((1 << 2 * (log + 1)) - 4))] if flat else np.uint32(0)
    even, odd = np.uint32((mean & LANES) << np.uint32(8)), np.uint32(mean & ~LANES)
    for i in range(padded(count)):
        out[0, i] = even
        out[1, i] = odd
    if flat:
        return
    halvings, level, coarse = probes_of(major, minor, log)
    if halvings == 0:
        if coarse < 256 - LEVEL_BLEND:
            weight = 256 if coarse < LEVEL_BLEND else 256 - coarse
            _add_texels(texels, start, log, level, xy, 0, 0, weight, count, corners, out)
        if coarse >= LEVEL_BLEND:
            weight = coarse if coarse < 256 - LEVEL_BLEND else 256
            _add_texels(texels, start, log, level + 1, xy, 0, 0, weight, count, corners, out)
        return
    # With several probes the two mip levels are blended by sharing the probes between them.
    probes = 1 << halvings
    step_x, step_y = int(step_s * 256.0) >> halvings, int(step_t * 256.0) >> halvings
    x, y = -(step_x * (probes - 1) >> 1), -(step_y * (probes - 1) >> 1)
    from_coarse = (coarse * probes + 128) >> 8
    for k in range(probes):
        chosen = level + (1 if k < from_coarse else 0)
        _add_texels(texels, start, log, chosen, xy, x, y, 256 >> halvings, count, corners, out)
        x += step_x
        y += step_y


@kernel
def probes_of(major: float, minor: float, log: int) -> tuple[int, int, int]:
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


@inlined
def level_start(log: int, level: int) -> int:
    """Where a mip level begins: the levels before it hold 4^log + 4^(log-1) + ... texels."""
    return _FOURS & ((1 << 2 * (log + 1)) - (1 << 2 * (log - level + 1)))


@kernel
def _add_texels(
    texels: Words, start: int, log: int, level: int, xy: Places, dx: int, dy: int, weight: int, count: int,
    corners: Words, out: Words,
) -> None:  # fmt: skip
    """Add ``weight``, of 256, times bilinear samples of a mip level, shifted by (dx, dy) in 1/256 texel of level 0."""
    side = np.int32(1 << (log - level))
    last, base, shift = np.int32(side - 1), np.int32(start + level_start(log, level)), np.int32(level & 15)
    x0, y0, part = np.int32(dx), np.int32(dy), np.uint32(weight)
    whole = padded(count)
    # No loop has more streams than the compiler will check for overlap, beyond which it works pixel by pixel.
    for i in range(whole):
        x = np.int32(np.int32(np.int32(np.int32(xy[0, i] + x0) >> shift) - np.int32(128)) >> np.int32(8))
        corners[0, i] = _tile_column(np.int32(x & last))
        corners[1, i] = _tile_column(np.int32(np.int32(x + 1) & last))
    for i in range(whole):
        y = np.int32(np.int32(np.int32(np.int32(xy[1, i] + y0) >> shift) - np.int32(128)) >> np.int32(8))
        corners[2, i] = np.int32(base + _tile_row(np.int32(y & last), side))
        corners[3, i] = np.int32(base + _tile_row(np.int32(np.int32(y + 1) & last), side))
    _fetch(texels, whole, corners)
    for row in range(2):
        lane = np.uint32(8 * row)
        for i in range(whole):
            fx = np.uint32(np.int32(np.int32(np.int32(xy[0, i] + x0) >> shift) - np.int32(128)) & 255)
            fy = np.uint32(np.int32(np.int32(np.int32(xy[1, i] + y0) >> shift) - np.int32(128)) & 255)
            a, b = np.uint32(corners[0, i] >> lane), np.uint32(corners[1, i] >> lane)
            c, d = np.uint32(corners[2, i] >> lane), np.uint32(corners[3, i] >> lane)
            out[row, i] = np.uint32(out[row, i] + np.uint32(between(a, b, c, d, fx, fy) * part))


@kernel
def texel_at(texels: Words, base: int, bits: int, level: int, x: int, y: int) -> np.uint64:
    """One bilinear sample of the level of side 2^bits at ``base``: lanes 0, 2, 1, 3 of 16 bits, 255 for full."""
    last, side = (1 << bits) - 1, 1 << bits
    x, y = (x >> level) - 128, (y >> level) - 128
    fx, fy = np.uint64(x & 255), np.uint64(y & 255)
    x, y = x >> 8, y >> 8
    left, right = (x & last & -4) * 4 + (x & 3), (x + 1 & last & -4) * 4 + (x + 1 & 3)
    upper, lower = base + (y & last & -4) * side + (y & 3) * 4, base + (y + 1 & last & -4) * side + (y + 1 & 3) * 4
    gx, gy = _ONE - fx, _ONE - fy
    # An unsigned index spares the test whether it counts from the end.
    a, b = _spread(texels[np.uint64(upper + left)]), _spread(texels[np.uint64(upper + right)])
    c, d = _spread(texels[np.uint64(lower + left)]), _spread(texels[np.uint64(lower + right)])
    above = (a * gx + b * fx) >> _U8 & _FOUR_LANES
    below = (c * gx + d * fx) >> _U8 & _FOUR_LANES
    return (above * gy + below * fy) >> _U8 & _FOUR_LANES


@kernel
def _spread(texel: np.uint32) -> np.uint64:
    """Four bytes as four 16-bit lanes, in the order 0, 2, 1, 3."""
    word = np.uint64(texel)
    return (word & _EVEN_LANES) | (word & _ODD_LANES) << _U24


@kernel
def _fetch(texels: Words, count: int, corners: Words) -> None:
    """Replace the parts of indices of left and right, upper and lower by the four texels there.

    It is apart from the arithmetic, for only this is not done eight at a time.
    """
    for i in range(count):
        left, right, upper, lower = corners[0, i], corners[1, i], corners[2, i], corners[3, i]
        corners[0, i], corners[1, i] = texels[np.uint32(upper + left)], texels[np.uint32(upper + right)]
        corners[2, i], corners[3, i] = texels[np.uint32(lower + left)], texels[np.uint32(lower + right)]


@inlined
def between(a: np.uint32, b: np.uint32, c: np.uint32, d: np.uint32, x: np.uint32, y: np.uint32) -> np.uint32:
    """Bilinear between the even lanes of four texels, at x, y in 0..256."""
    p, q = np.uint32(np.uint32(256) - x), np.uint32(np.uint32(256) - y)
    above = np.uint32(np.uint32(np.uint32(a & LANES) * p) + np.uint32(np.uint32(b & LANES) * x))
    below = np.uint32(np.uint32(np.uint32(c & LANES) * p) + np.uint32(np.uint32(d & LANES) * x))
    above, below = (
        np.uint32(np.uint32(above >> np.uint32(8)) & LANES),
        np.uint32(np.uint32(below >> np.uint32(8)) & LANES),
    )
    total = np.uint32(np.uint32(above * q) + np.uint32(below * y))
    return np.uint32(np.uint32(total >> np.uint32(8)) & LANES)


@inlined
def _tile_column(x: np.int32) -> np.int32:
    """The part of a texel's index that its column makes: images are kept in tiles of 4x4, one to a line of cache."""
    return np.int32(np.int32(np.int32(x & np.int32(-4)) * np.int32(4)) + np.int32(x & np.int32(3)))


@inlined
def _tile_row(y: np.int32, side: np.int32) -> np.int32:
    """The part of a texel's index that its row makes, in an image of a ``side``."""
    return np.int32(np.int32(np.int32(y & np.int32(-4)) * side) + np.int32(np.int32(y & np.int32(3)) * np.int32(4)))


@kernel
def spread_out(thin: Words, count: int, out: Words) -> None:
    """Interpolate words of every fourth pixel, each of two lanes of 16 bits, to all ``count``."""
    for i in range((count + 3) >> 2):
        before = np.uint32(np.uint32(thin[i] >> np.uint32(2)) & _QUARTER)
        after = np.uint32(np.uint32(thin[i + 1] >> np.uint32(2)) & _QUARTER)
        for k in range(4):
            out[4 * i + k] = np.uint32(before * np.uint32(4 - k) + after * np.uint32(k))


@kernel
def ground_light(
    light: Words, log: int, footprint: Footprint, xy: Places, count: int, corners: Words, out: Words
) -> None:
    """Sun in the low and sky in the high half of a word of ``out``, on the ground along a span.

    ``xy`` are places in 1/256 texel of the shadow map's level 0.
    """
    breadth, level = footprint[1], 0
    while breadth >= 1.0 and level < log - 4:
        breadth *= 0.25
        level += 1
    side, zero = np.int32(1 << (log - level)), np.int32(0)
    most, base, shift = np.int32(side - 1), np.int32(level_start(log, level)), np.int32(level & 15)
    whole = padded(count)
    for i in range(whole):
        x = np.int32(np.int32(np.int32(xy[0, i] >> shift) - np.int32(128)) >> np.int32(8))
        corners[0, i] = _tile_column(np.int32(min(max(x, zero), most)))
        corners[1, i] = _tile_column(np.int32(min(max(np.int32(x + 1), zero), most)))
    for i in range(whole):
        y = np.int32(np.int32(np.int32(xy[1, i] >> shift) - np.int32(128)) >> np.int32(8))
        corners[2, i] = np.int32(base + _tile_row(np.int32(min(max(y, zero), most)), side))
        corners[3, i] = np.int32(base + _tile_row(np.int32(min(max(np.int32(y + 1), zero), most)), side))
    _fetch(light, whole, corners)
    for i in range(whole):
        fx = np.uint32(np.int32(np.int32(xy[0, i] >> shift) - np.int32(128)) & 255)
        fy = np.uint32(np.int32(np.int32(xy[1, i] >> shift) - np.int32(128)) & 255)
        out[i] = _blend(corners[0, i], corners[1, i], corners[2, i], corners[3, i], fx, fy)


@kernel
def chart_light(
    light: Words, start: int, width: int, height: int, xy: Places, count: int, corners: Words, out: Words
) -> None:
    """Sun and sky along a span on a chart, as :func:`ground_light`; the samples lie at whole numbers."""
    first, wide, zero = np.int32(start), np.int32(width), np.int32(0)
    last_x, last_y = np.int32((width - 1) * 256 - 1), np.int32((height - 1) * 256 - 1)
    whole = padded(count)
    for i in range(whole):
        x = np.int32(min(max(xy[0, i], zero), last_x) >> np.int32(8))
        corners[0, i], corners[1, i] = x, np.int32(x + 1)
    for i in range(whole):
        y = np.int32(min(max(xy[1, i], zero), last_y) >> np.int32(8))
        corners[2, i] = np.int32(first + np.int32(y * wide))
        corners[3, i] = np.int32(first + np.int32(np.int32(y + 1) * wide))
    _fetch(light, whole, corners)
    for i in range(whole):
        fx, fy = np.uint32(min(max(xy[0, i], zero), last_x) & 255), np.uint32(min(max(xy[1, i], zero), last_y) & 255)
        out[i] = _blend(corners[0, i], corners[1, i], corners[2, i], corners[3, i], fx, fy)


@inlined
def _blend(a: np.uint32, b: np.uint32, c: np.uint32, d: np.uint32, x: np.uint32, y: np.uint32) -> np.uint32:
    """Bilinear between the two halves of four samples of light, at x, y in 0..256."""
    low = _weighted(np.uint32(a & LOW16), np.uint32(b & LOW16), np.uint32(c & LOW16), np.uint32(d & LOW16), x, y)
    s = np.uint32(16)
    high = _weighted(np.uint32(a >> s), np.uint32(b >> s), np.uint32(c >> s), np.uint32(d >> s), x, y)
    return np.uint32(low | np.uint32(high << s))


@inlined
def _weighted(a: np.uint32, b: np.uint32, c: np.uint32, d: np.uint32, x: np.uint32, y: np.uint32) -> np.uint32:
    """Bilinear between four numbers of 16 bits."""
    p, q = np.uint32(np.uint32(256) - x), np.uint32(np.uint32(256) - y)
    above = np.uint32(np.uint32(np.uint32(a * p) + np.uint32(b * x)) >> np.uint32(8))
    below = np.uint32(np.uint32(np.uint32(c * p) + np.uint32(d * x)) >> np.uint32(8))
    return np.uint32(np.uint32(np.uint32(above * q) + np.uint32(below * y)) >> np.uint32(8))
