"""What two cameras with known lenses see of a board: rendered with distortion, blur and noise."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from services.sensors.calibration.board import Board
from services.sensors.calibration.rig import Lens, StereoRig

BOARD = Board(7, 5, 0.04, 0.03, "5X5_100")
SIZE = (480, 320)
_OVERSAMPLING = 3
_TEXTURE = 64


def rig(size=SIZE, baseline=0.12, turn=(0.01, -0.015, 0.006)):
    """Two cameras that differ, that are not quite parallel, and whose lenses distort."""
    width, height = size
    f = 0.8 * width
    left = Lens(f, f * 1.002, width / 2 - 4.3, height / 2 + 3.1, np.array([-0.22, 0.08, 0.0009, -0.0006, -0.01]))
    right = Lens(f * 1.01, f * 1.011, width / 2 + 5.2, height / 2 - 2.4, np.array([-0.21, 0.07, -0.0007, 0.0005, 0.0]))
    return StereoRig(width, height, left, right, cv2.Rodrigues(np.array(turn))[0], np.array([-baseline, 0.0015, 0.002]))


def poses(count, rng, board=BOARD, size=SIZE, tilt=0.65, near=0.3, far=0.6):
    """Poses (count, 4, 4) of the board in the left camera: over the image, at all distances, tilted every way."""
    width, height = size
    middle = np.array([board.columns * board.square / 2, board.rows * board.square / 2, 0.0])
    out = np.tile(np.eye(4), (count, 1, 1))
    for k in range(count):
        depth = near + (far - near) * ((k * 0.618) % 1.0)
        aim = rng.uniform(-0.33, 0.33, 2) * np.array([1.0, height / width]) / 0.8 * depth * (0.4 + depth / far * 0.6)
        direction = 2 * np.pi * ((k * 0.382) % 1.0)
        lean = tilt * rng.uniform(0.55, 1.0)
        R = cv2.Rodrigues(np.array([lean * np.cos(direction), lean * np.sin(direction), rng.uniform(-0.5, 0.5)]))[0]
        out[k, :3, :3] = R
        out[k, :3, 3] = np.array([aim[0] + 0.04, aim[1], depth]) - R @ middle
    return out


@dataclass
class Renderer:
    """Renders one board as one rig sees it."""

    rig: StereoRig
    board: Board = BOARD

    def __post_init__(self):
        self._texture = self.board.draw(_TEXTURE, _TEXTURE // 2).astype(np.float32)
        self._rays = [_rays(lens, self.rig.width, self.rig.height) for lens in (self.rig.left, self.rig.right)]

    def pair(self, T_left_board, rng, blur=0.7, noise=2.0):
        """Left and right image (H, W), uint8, of the board at ``T_left_board``."""
        T_right_left = np.eye(4)
        T_right_left[:3, :3], T_right_left[:3, 3] = self.rig.R, self.rig.T
        return tuple(
            self._image(rays, T, rng, blur, noise)
            for rays, T in zip(self._rays, (T_left_board, T_right_left @ T_left_board), strict=True)
        )

    def _image(self, rays, T, rng, blur, noise):
        to_board = np.linalg.inv(np.stack([T[:3, 0], T[:3, 1], T[:3, 3]], axis=1))
        x, y, w = (rays @ to_board.T.astype(np.float32)).transpose(2, 0, 1)
        scale = _TEXTURE / self.board.square
        u, v = x / w * scale + _TEXTURE / 2 - 0.5, y / w * scale + _TEXTURE / 2 - 0.5
        ink = cv2.remap(self._texture, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=-1.0)
        height, width = ink.shape
        ground = cv2.resize(rng.uniform(50, 140, (9, 13)).astype(np.float32), (width, height))
        fine = np.where(ink >= 0.0, 35.0 + 175.0 / 255.0 * ink, ground)
        image = cv2.resize(fine, (self.rig.width, self.rig.height), interpolation=cv2.INTER_AREA)
        if blur > 0.0:
            image = cv2.GaussianBlur(image, (0, 0), blur)
        return np.clip(np.round(image + rng.normal(0.0, noise, image.shape)), 0, 255).astype(np.uint8)


def _rays(lens, width, height):
    """Directions (H, W, 3) of the parts of each pixel: the distortion undone by fixed-point iteration."""
    v, u = np.mgrid[0:height, 0:width].astype(np.float64)
    xd, yd = (u - lens.cx) / lens.fx, (v - lens.cy) / lens.fy
    x, y = xd.copy(), yd.copy()
    k1, k2, p1, p2, k3 = lens.distortion[:5]
    for _ in range(60):
        r2 = x * x + y * y
        radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
        x, y = (
            (xd - 2 * p1 * x * y - p2 * (r2 + 2 * x * x)) / radial,
            (yd - p1 * (r2 + 2 * y * y) - 2 * p2 * x * y) / radial,
        )
    fine = (width * _OVERSAMPLING, height * _OVERSAMPLING)
    x, y = (cv2.resize(c, fine, interpolation=cv2.INTER_CUBIC) for c in (x, y))
    return np.stack([x, y, np.ones_like(x)], axis=-1).astype(np.float32)


def render_set(count=14, seed=1, renderer=None, **look):
    """Names with pairs of images of a set; ``look`` goes to :meth:`Renderer.pair`."""
    rng = np.random.default_rng(seed)
    renderer = renderer or Renderer(rig())
    size = (renderer.rig.width, renderer.rig.height)
    return [(f"{k:03d}", *renderer.pair(T, rng, **look)) for k, T in enumerate(poses(count, rng, renderer.board, size))]
