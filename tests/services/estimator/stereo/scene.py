"""A simulated world for the tests: textured planes, rendered exactly from any pose."""

from __future__ import annotations

import cv2
import numpy as np

from common import geometry
from common.camera import StereoCamera

CAMERA = StereoCamera(480, 320, 360.0, 360.0, 239.5, 159.5, 0.25)
_TEXTURE_METRES = 0.02
_SIZE = 1024


def _texture(seed):
    rng = np.random.default_rng(seed)
    total = np.zeros((_SIZE, _SIZE), np.float32)
    for cell, weight in ((4, 1.0), (12, 1.5), (48, 1.0)):
        small = rng.normal(size=(_SIZE // cell + 2, _SIZE // cell + 2)).astype(np.float32)
        total += weight * cv2.resize(small, (_SIZE, _SIZE), interpolation=cv2.INTER_CUBIC)
    return cv2.normalize(total, None, 10, 245, cv2.NORM_MINMAX)


def shifted_texture(shift, size, seed=0, blur=1.6):
    """Two images (float32) of one texture; what is at x in the first is at ``x + shift`` in the second.

    ``shift`` is ``(x, y)`` in multiples of an eighth of a pixel: both are sampled from a texture eight times as fine,
    so that no interpolation of the test's own is measured.
    """
    (width, height), margin = size, 8 * 96
    fine = np.random.default_rng(seed).normal(size=(height + 192, width + 192)).astype(np.float32)
    fine = cv2.resize(cv2.GaussianBlur(fine, (0, 0), blur), None, fx=8, fy=8, interpolation=cv2.INTER_CUBIC)
    fine = cv2.blur(cv2.normalize(fine, None, 20, 230, cv2.NORM_MINMAX), (8, 8))
    dx, dy = (round(8 * s) for s in shift)
    first = fine[margin:, margin:][::8, ::8][:height, :width]
    return first, fine[margin - dy :, margin - dx :][::8, ::8][:height, :width]


# Each plane: a point, two axes and the bounds along them, metres in the world's optical frame (y down).
_PLANES = [
    (np.array([0.0, 1.2, 0.0]), np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0]), (-6, 6, -2, 14)),
    (np.array([-2.0, 0.0, 6.0]), np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0]), (-1.2, 1.2, -2, 1.2)),
    (np.array([2.2, 0.0, 4.5]), np.array([0.8, 0.0, 0.6]), np.array([0.0, 1.0, 0.0]), (-1.0, 1.0, -0.8, 1.2)),
    (np.array([0.0, 0.0, 13.0]), np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0]), (-10, 10, -6, 1.2)),
]
_TEXTURES = [_texture(seed) for seed in range(len(_PLANES))]


def _view(T_world_camera, camera):
    v, u = np.mgrid[0 : camera.height, 0 : camera.width]
    rays = np.stack([(u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy, np.ones(u.shape)], -1)
    rays = rays @ T_world_camera[:3, :3].T
    nearest = np.full(u.shape, np.inf)
    image = np.full(u.shape, 128.0, np.float32)
    for (point, a, b, bounds), texture in zip(_PLANES, _TEXTURES, strict=True):
        normal = np.cross(a, b)
        with np.errstate(divide="ignore", invalid="ignore"):
            depth = ((point - T_world_camera[:3, 3]) @ normal) / (rays @ normal)
            hit = T_world_camera[:3, 3] + depth[..., None] * rays - point
            x, y = hit @ a, hit @ b
            seen = (depth > 0.1) & (depth < nearest)
            seen &= (x >= bounds[0]) & (x <= bounds[1]) & (y >= bounds[2]) & (y <= bounds[3])
            scaled = [np.nan_to_num(c / _TEXTURE_METRES + _SIZE / 2).astype(np.float32) % (_SIZE - 1) for c in (x, y)]
        colours = cv2.remap(texture, scaled[0], scaled[1], cv2.INTER_LINEAR)
        image[seen], nearest[seen] = colours[seen], depth[seen]
    return image


def render(T_world_left, camera=CAMERA, noise=1.0, seed=0):
    """A stereo pair of uint8 images from a pose of the left camera."""
    rng = np.random.default_rng(seed)
    T_left_right = geometry.transform(np.eye(3), [camera.baseline, 0.0, 0.0])
    images = [_view(T, camera) for T in (T_world_left, T_world_left @ T_left_right)]
    return tuple(np.clip(i + rng.normal(0.0, noise, i.shape), 0, 255).astype(np.uint8) for i in images)


def landmarks(rng, count, near=4.0, far=60.0, camera=CAMERA):
    """True measurements (N, 3) ``(u, v, d)`` of points all over the image."""
    u, v = rng.uniform(20, camera.width - 20, count), rng.uniform(20, camera.height - 20, count)
    z = np.exp(rng.uniform(np.log(near), np.log(far), count))
    return np.stack([u, v, camera.fx * camera.baseline / z], -1)
