"""Orientations and descriptors of many blobs at once: see ``orientation`` and ``descriptor`` of the package."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from services.estimator.surf import descriptor, orientation
from services.estimator.surf.arrays.device import Array
from services.estimator.surf.arrays.sums import Sums, interpolated
from services.estimator.surf.features import VALUES

AT_ONCE = 256
"""Blobs that are worked on at once: bounds the memory, 100 kB each."""


def _angles(sums: Sums, u: Array, v: Array, scales: Array) -> Array:
    """Angles (N,) of blobs at (N,) coordinates of the sums."""
    device, xp = sums.device, sums.device.xp
    reach, half, bins = orientation.REACH, orientation.HALF, orientation.BINS
    steps = device.upload(np.arange(-reach, reach + 1, dtype=np.float64))
    grid = scales[:, None] * steps[None, :]
    corners = interpolated(sums, (u[:, None] + grid)[:, None, :], (v[:, None] + grid)[:, :, None])
    corners = xp.reshape(corners, (u.shape[0], -1))
    rows, columns = orientation.SAMPLES.T

    def corner(down: int, right: int) -> Array:
        index = (rows + down) * (2 * reach + 1) + columns + right
        return xp.take(corners, device.upload(index), axis=1)

    top_left, top, top_right = (corner(-half, at) for at in (-half, 0, half))
    bottom_left, bottom, bottom_right = (corner(half, at) for at in (-half, 0, half))
    dx = (bottom_right - top_right) + (bottom_left - top_left) - 2.0 * (bottom - top)
    dy = (bottom_right - bottom_left) + (top_right - top_left) - 2.0 * (corner(0, half) - corner(0, -half))
    turns = (xp.atan2(dy, dx) + np.pi) * (bins / (2.0 * np.pi)) + 0.5
    direction = xp.astype(xp.floor(turns), xp.int64) % bins
    here = direction[:, None, :] == device.upload(np.arange(bins))[None, :, None]
    weights = device.upload(orientation.WEIGHTS)
    weighted = xp.stack([weights * dx, weights * dy], axis=-1)
    total = xp.matmul(device.upload(orientation.SECTORS), xp.matmul(xp.astype(here, xp.float64), weighted))
    x, y = total[..., 0], total[..., 1]
    best = xp.argmax(x * x + y * y, axis=1)
    chosen = xp.astype(best[:, None] == device.upload(np.arange(bins))[None, :], xp.float64)
    return xp.atan2(xp.sum(chosen * y, axis=1), xp.sum(chosen * x, axis=1))


def _descriptors(sums: Sums, u: Array, v: Array, scales: Array, angles: Array) -> Array:
    """Descriptors (N, 64) float64."""
    device, xp = sums.device, sums.device.xp
    steps = device.upload(np.arange(descriptor.GRID + 1) - descriptor.GRID / 2)
    right, down = steps[None, None, :], steps[None, :, None]
    cos, sin = (scales * xp.cos(angles))[:, None, None], (scales * xp.sin(angles))[:, None, None]
    at_u = u[:, None, None] + cos * right - sin * down
    at_v = v[:, None, None] + sin * right + cos * down
    half = 0.5 * scales[:, None, None]
    top = interpolated(sums, at_u + half, at_v - half) - interpolated(sums, at_u - half, at_v - half)
    bottom = interpolated(sums, at_u + half, at_v + half) - interpolated(sums, at_u - half, at_v + half)
    means = (bottom - top) / (4.0 * half * half)
    falling, rising = means[:, 1:, 1:] - means[:, :-1, :-1], means[:, :-1, 1:] - means[:, 1:, :-1]
    dx, dy = falling + rising, falling - rising
    responses = xp.stack([dx, dy, xp.abs(dx), xp.abs(dy)], axis=1)
    shares = device.upload(descriptor.SHARES)
    parts = xp.matmul(xp.matmul(shares, responses), xp.permute_dims(shares, (1, 0)))
    values = xp.reshape(xp.permute_dims(parts, (0, 2, 3, 1)), (u.shape[0], -1))
    length = xp.sqrt(xp.sum(values * values, axis=1, keepdims=True))
    return values / xp.clip(length, descriptor.TINY, None)


def describe(
    sums: Sums, points: NDArray[np.float64], scales: NDArray[np.float64], *, upright: bool
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Angles (N,) and descriptors (N, 64) of blobs at points (N, 2), pixels, with their scales (N,)."""
    device, xp = sums.device, sums.device.xp
    angles, descriptors = np.zeros(len(points), np.float32), np.zeros((len(points), VALUES), np.float32)
    for begin in range(0, len(points), AT_ONCE):
        part = slice(begin, begin + AT_ONCE)
        u, v = (device.upload(points[part, i] + 0.5 + pad) for i, pad in ((0, sums.pad_x), (1, sums.pad_y)))
        scale = device.upload(scales[part])
        turned = xp.zeros_like(scale) if upright else _angles(sums, u, v, scale)
        angles[part] = device.download(turned)
        descriptors[part] = device.download(_descriptors(sums, u, v, scale, turned))
    return angles, descriptors
