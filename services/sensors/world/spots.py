"""What the spot of a lidar's beam covers: its reflectance, filtered over the spot's ellipse; compiled."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from common.geometry import Array
from services.sensors.world.geometry import MATERIAL, TEXTURE, Floats
from services.sensors.world.kernel import inlined, kernel
from services.sensors.world.sampling import Words, level_start, texel_at
from services.sensors.world.spectra import MATERIAL_INDEX

_GROUND = MATERIAL_INDEX["ground"]
_GRAZING = 0.02
"""Least cosine of the incidence for which a spot's length is followed."""
_STRAIGHT = 1e-6
_U16 = np.uint64(0xFFFF)
_UNIT = 1.0 / 65280.0
"""What one is in a lane of :func:`_over_spot`."""

Lanes = tuple[float, float, float, float]


@kernel
def reflected(
    origins: Floats, directions: Floats, distance: Array, polygon: NDArray[np.int64], divergence: float,
    normals: Array, maps: Array, weights: Array, indices: NDArray[np.int64],
    texels: Words, starts: NDArray[np.int64], logs: NDArray[np.int64], reflectances: Array, out: Floats,
) -> None:  # fmt: skip
    """Write the part (N,) of the light that a white surface facing the beam would send back; 0 for a miss.

    The rays are ``origins`` and unit ``directions`` (N, 3), which hit ``polygon`` (N,), -1 for a miss, at ``distance``
    (N,) metres. A surface is Lambertian: what it sends back is its reflectance times the cosine of the incidence.
    ``normals``, ``maps``, ``weights`` and ``indices`` are those of
    :class:`~services.sensors.world.geometry.Geometry`; ``reflectances`` (M, 4) of each material's endmembers.
    """
    ground_map = len(starts) - 1
    for i in range(len(out)):
        n = polygon[i]
        if n < 0:
            out[i] = 0.0
            continue
        x, y, z = float(directions[i, 0]), float(directions[i, 1]), float(directions[i, 2])
        nx, ny, nz = normals[n]
        r = distance[i]
        px, py, pz = origins[i, 0] + r * x, origins[i, 1] + r * y, origins[i, 2] + r * z
        along = x * nx + y * ny + z * nz
        cosine = abs(along)
        # The spot's axes: its length lies where the beam's direction falls on the surface.
        ax, ay, az = x - along * nx, y - along * ny, z - along * nz
        length = np.sqrt(ax * ax + ay * ay + az * az)
        if length < _STRAIGHT:
            # The beam is head-on and the spot is round; any axis in the surface will do.
            ax, ay, az = (0.0, nz, -ny) if abs(nx) > 0.5 else (nz, 0.0, -nx)
            length = np.sqrt(ax * ax + ay * ay + az * az)
        wide = r * divergence
        tall = wide / (length * max(cosine, _GRAZING))
        bx, by, bz = ny * az - nz * ay, nz * ax - nx * az, nx * ay - ny * ax
        ax, ay, az = ax * tall, ay * tall, az * tall
        bx, by, bz = bx * wide / length, by * wide / length, bz * wide / length
        texture, material = indices[n, TEXTURE], indices[n, MATERIAL]
        d0, d1, d2, d3 = _seen(
            texels, starts[texture], logs[texture], maps[n], 0, px, py, pz, ax, ay, az, bx, by, bz
        )  # fmt: skip
        if material == _GROUND:
            g0, g1, g2, g3 = _seen(
                texels, starts[ground_map], logs[ground_map], maps[n], 2, px, py, pz, ax, ay, az, bx, by, bz
            )  # fmt: skip
            d0, d1, d2, d3 = d0 * g0, d1 * g1, d2 * g2, d3 * g3
        w, f = weights[n], reflectances[material]
        albedo = w[0] * d0 * f[0] + w[1] * d1 * f[1] + w[2] * d2 * f[2] + w[3] * d3 * f[3]
        out[i] = min(albedo, 1.0) * cosine


@inlined
def _seen(
    texels: Words, start: int, log: int, maps: Array, first: int,
    px: float, py: float, pz: float, ax: float, ay: float, az: float, bx: float, by: float, bz: float,
) -> Lanes:  # fmt: skip
    """A texture's four lanes over the spot around a point, by rows ``first`` and ``first + 1`` of a polygon's maps."""
    mu, mv = maps[first], maps[first + 1]
    u = mu[0] * px + mu[1] * py + mu[2] * pz + mu[3]
    v = mv[0] * px + mv[1] * py + mv[2] * pz + mv[3]
    au, av = mu[0] * ax + mu[1] * ay + mu[2] * az, mv[0] * ax + mv[1] * ay + mv[2] * az
    bu, bv = mu[0] * bx + mu[1] * by + mu[2] * bz, mv[0] * bx + mv[1] * by + mv[2] * bz
    return _over_spot(texels, start, log, u, v, au, av, bu * bu + bv * bv)


@kernel
def _over_spot(texels: Words, start: int, log: int, u: float, v: float, au: float, av: float, breadth: float) -> Lanes:
    """The mean of a texture, lanes of 0..1, over an ellipse around (u, v) texels.

    Its length is the vector (au, av), its breadth's square ``breadth``. As
    :func:`~services.sensors.world.sampling.filtered` does for a span of pixels, up to eight samples along the length,
    each from the mip level of the width that remains, here without a limit on the length: a lidar on a vehicle sees
    most of the ground at a grazing angle.
    """
    length = au * au + av * av
    halvings = 0
    while halvings < 3 and length > 4.0 * breadth and length > 4.0:
        length *= 0.25
        halvings += 1
    width, level = max(length, breadth, 1.0), 0
    while width >= 4.0 and level < log - 3:
        width *= 0.25
        level += 1
    coarse = int(min((width - 1.0) * (256.0 / 3.0), 256.0))
    probes = 1 << halvings
    fine_start, coarse_start = start + level_start(log, level), start + level_start(log, level + 1)
    x, y = 256.0 * (u - 0.5 * au * (1.0 - 1.0 / probes)), 256.0 * (v - 0.5 * av * (1.0 - 1.0 / probes))
    step_x, step_y = 256.0 * au / probes, 256.0 * av / probes
    whole, share = np.uint64(0), np.uint64(256 >> halvings)
    # The two mip levels are blended by sharing the probes between them.
    from_coarse = (coarse * probes + 128) >> 8
    for k in range(probes):
        at_x, at_y = int(x + k * step_x), int(y + k * step_y)
        if k < from_coarse:
            whole += texel_at(texels, coarse_start, log - level - 1, level + 1, at_x, at_y) * share
        else:
            whole += texel_at(texels, fine_start, log - level, level, at_x, at_y) * share
    return (
        np.int64(whole & _U16) * _UNIT,
        np.int64(whole >> np.uint64(32) & _U16) * _UNIT,
        np.int64(whole >> np.uint64(16) & _U16) * _UNIT,
        np.int64(whole >> np.uint64(48)) * _UNIT,
    )
