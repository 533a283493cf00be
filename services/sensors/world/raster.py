"""Which polygon each sample of an image shows: clipping, projection and depth test, compiled."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from common.geometry import Array
from services.sensors.world.geometry import Floats
from services.sensors.world.kernel import kernel

NEAR = 0.1
"""Metres before the camera within which nothing is drawn."""
_EDGE_ON = 1e-5


@kernel
def rasterise(
    corners: Floats,
    sizes: NDArray[np.int32],
    normals: Array,
    two_sided: NDArray[np.bool_],
    group_starts: NDArray[np.int64],
    group_spheres: Array,
    maps: Array,
    R_camera_world: Array,
    centre: Array,
    intrinsics: Array,
    samples: int,
    inverse_depth: Floats,
    polygon: NDArray[np.int32],
    screen: Floats,
    scratch: Array,
) -> None:
    """Fill the sample grids of a camera.

    ``R_camera_world`` (3, 3) takes the world's axes to the optical frame's, ``centre`` (3,) is the optical
    centre in the world, ``intrinsics`` (4,) are fx, fy, cx, cy. There are ``samples`` x ``samples`` samples a
    pixel: sample (i, j) is at v = (i + 0.5) / samples - 0.5, likewise u.

    Writes ``inverse_depth`` (H*s, W*s) 1/m, 0 for the sky; ``polygon`` (H*s, W*s), -1 for the sky; and for each
    polygon that was drawn a row of ``screen`` (N, 16), a line of cache, five functions linear in the pixel
    ``[u, v, 1]``: 1/z, then the coordinates of ``maps`` (N, 4, 4) divided by z. ``scratch`` (8, 8) is overwritten.
    """
    rows, columns = inverse_depth.shape
    inverse_depth[:] = 0.0
    polygon[:] = -1
    fx, fy, cx, cy = intrinsics
    x, y, camera, clipped = scratch[0], scratch[1], scratch[2:5], scratch[5:8]
    for group in range(len(group_starts) - 1):
        if _out_of_view(group_spheres[group], R_camera_world, centre, intrinsics, columns / samples, rows / samples):
            continue
        for n in range(group_starts[group], group_starts[group + 1]):
            distance = _distance(normals[n], corners[n, 0], centre)
            if abs(distance) < _EDGE_ON or (distance > 0.0 and not two_sided[n]):
                continue
            count = sizes[n]
            _to_camera(corners[n], count, R_camera_world, centre, camera)
            count = _clip(camera, count, clipped)
            if count < 3:
                continue
            for k in range(count):
                x[k] = (fx * clipped[0, k] / clipped[2, k] + cx + 0.5) * samples - 0.5
                y[k] = (fy * clipped[1, k] / clipped[2, k] + cy + 0.5) * samples - 0.5
            _to_screen(normals[n], distance, maps[n], R_camera_world, centre, intrinsics, screen[n])
            a, b, c = screen[n, 0], screen[n, 1], screen[n, 2]
            _fill(x, y, count, a, b, c, samples, n, inverse_depth, polygon)


@kernel
def _distance(normal: Array, corner: Floats, centre: Array) -> float:
    """From the camera to a polygon's plane, along its normal: negative for one that is seen from outside."""
    total = 0.0
    for k in range(3):
        total += normal[k] * (corner[k] - centre[k])
    return total


@kernel
def _to_screen(
    normal: Array, distance: float, maps: Array, R: Array, centre: Array, intrinsics: Array, out: Floats
) -> None:
    """A polygon's row of ``screen``.

    With P = centre + z R^T ray, a coordinate m . P + m3 is z ((m . centre + m3) / z + m . R^T ray).
    """
    _linear(normal, R, intrinsics, distance, out[0:3])
    for k in range(4):
        offset = maps[k, 3]
        for i in range(3):
            offset += maps[k, i] * centre[i]
        _linear(maps[k], R, intrinsics, 1.0, out[3 * k + 3 : 3 * k + 6])
        for i in range(3):
            out[3 * k + 3 + i] += offset * out[i]


@kernel
def _linear(q: Array, R: Array, intrinsics: Array, divisor: float, out: Floats) -> None:
    """The coefficients (3,) of ``q . (R^T ray) / divisor`` in the pixel ``[u, v, 1]``, with q (3,) of the world."""
    fx, fy, cx, cy = intrinsics
    a = (R[0, 0] * q[0] + R[0, 1] * q[1] + R[0, 2] * q[2]) / (fx * divisor)
    b = (R[1, 0] * q[0] + R[1, 1] * q[1] + R[1, 2] * q[2]) / (fy * divisor)
    c = (R[2, 0] * q[0] + R[2, 1] * q[1] + R[2, 2] * q[2]) / divisor
    out[0], out[1], out[2] = a, b, c - a * cx - b * cy


@kernel
def _out_of_view(sphere: Array, R: Array, centre: Array, intrinsics: Array, width: float, height: float) -> bool:
    """Whether a sphere lies wholly outside of the pyramid of view."""
    dx, dy, dz = sphere[0] - centre[0], sphere[1] - centre[1], sphere[2] - centre[2]
    px = R[0, 0] * dx + R[0, 1] * dy + R[0, 2] * dz
    py = R[1, 0] * dx + R[1, 1] * dy + R[1, 2] * dz
    pz = R[2, 0] * dx + R[2, 1] * dy + R[2, 2] * dz
    radius = sphere[3]
    if pz < -radius + NEAR:
        return True
    fx, fy, cx, cy = intrinsics
    left, right = (cx + 0.5) / fx, (width - 0.5 - cx) / fx
    top, bottom = (cy + 0.5) / fy, (height - 0.5 - cy) / fy
    return bool(
        -px - left * pz > radius * np.sqrt(1.0 + left * left)
        or px - right * pz > radius * np.sqrt(1.0 + right * right)
        or -py - top * pz > radius * np.sqrt(1.0 + top * top)
        or py - bottom * pz > radius * np.sqrt(1.0 + bottom * bottom)
    )


@kernel
def _to_camera(corners: Floats, count: int, R: Array, centre: Array, out: Array) -> None:
    """Corners (count, 3) of the world in the optical frame, as columns."""
    for i in range(count):
        dx, dy, dz = corners[i, 0] - centre[0], corners[i, 1] - centre[1], corners[i, 2] - centre[2]
        for k in range(3):
            out[k, i] = R[k, 0] * dx + R[k, 1] * dy + R[k, 2] * dz


@kernel
def _clip(polygon: Array, count: int, out: Array) -> int:
    """What of a polygon lies beyond the near plane (Sutherland and Hodgman, 1974); the number of its corners."""
    kept = 0
    for i in range(count):
        j = i + 1 if i + 1 < count else 0
        here, there = polygon[2, i] - NEAR, polygon[2, j] - NEAR
        if here >= 0.0:
            for k in range(3):
                out[k, kept] = polygon[k, i]
            kept += 1
        if (here >= 0.0) != (there >= 0.0):
            f = here / (here - there)
            for k in range(3):
                out[k, kept] = polygon[k, i] + f * (polygon[k, j] - polygon[k, i])
            kept += 1
    return kept


@kernel
def _fill(
    x: Array,
    y: Array,
    count: int,
    a: float,
    b: float,
    c: float,
    samples: int,
    name: int,
    inverse_depth: Floats,
    polygon: NDArray[np.int32],
) -> None:
    """Draw a convex polygon of sample coordinates x, y, row by row, where it is nearer than what is there."""
    rows, columns = inverse_depth.shape
    top, bottom, left, right = y[0], y[0], x[0], x[0]
    for k in range(1, count):
        top, bottom = min(top, y[k]), max(bottom, y[k])
        left, right = min(left, x[k]), max(right, x[k])
    if right < 0.0 or left > columns - 1 or bottom < 0.0 or top > rows - 1:
        return
    scale = 1.0 / samples
    shift = 0.5 * scale - 0.5
    step = np.float32(a * scale)
    for row in range(max(0, int(np.ceil(top))), min(rows - 1, int(np.floor(bottom))) + 1):
        left, right = 1e9, -1e9
        for k in range(count):
            j = k + 1 if k + 1 < count else 0
            if (y[k] <= row) != (y[j] <= row):
                cross = x[k] + (row - y[k]) * (x[j] - x[k]) / (y[j] - y[k])
                left, right = min(left, cross), max(right, cross)
        # A sample on an edge belongs to the polygon on its right, so that neighbours leave no gap.
        first, last = max(0, int(np.ceil(left))), min(columns, int(np.ceil(right)))
        start = np.float32(a * shift + b * (row * scale + shift) + c)
        for column in range(first, last):
            depth = start + step * np.float32(column)
            nearer = depth > inverse_depth[row, column]
            # Selections instead of a branch, so that the loop runs eight samples at a time.
            inverse_depth[row, column] = depth if nearer else inverse_depth[row, column]
            polygon[row, column] = name if nearer else polygon[row, column]
