"""What two cameras with known lenses see of a board: rendered with distortion, blur and noise."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from common import geometry
from services.sensors.calibration.board import Board
from services.sensors.calibration.rig import Lens, StereoRig

Array = NDArray[np.float64]
Image = NDArray[np.uint8]

BOARD = Board(7, 5, 0.04, 0.03, "5X5_100")
SIZE = (480, 320)

_OVERSAMPLING = 3
_TEXTURE = 64
"""Pixels of a square in the texture that is rendered."""
_INK, _PAPER = 35.0, 210.0
_FIXED_POINT_STEPS = 60


def simulated_rig(size: tuple[int, int] = SIZE, baseline: float = 0.12) -> StereoRig:
    """Two cameras of 64 degrees of view that differ, that are not quite parallel, and whose lenses distort."""
    width, height = size
    f = 0.8 * width
    left = Lens(f, f * 1.002, width / 2 - 4.3, height / 2 + 3.1, np.array([-0.22, 0.08, 0.0009, -0.0006, -0.01]))
    right = Lens(f * 1.01, f * 1.011, width / 2 + 5.2, height / 2 - 2.4, np.array([-0.21, 0.07, -0.0007, 0.0005, 0.0]))
    R = geometry.so3_exp([0.01, -0.015, 0.006])
    return StereoRig(width, height, left, right, R, np.array([-baseline, 0.0015, 0.002]))


def simulated_poses(
    count: int, rng: np.random.Generator, board: Board = BOARD, size: tuple[int, int] = SIZE, tilt: float = 0.65
) -> Array:
    """Poses (count, 4, 4) of the board in the left camera: over the image, 0.3 to 0.6 m away, tilted every way.

    ``tilt`` is the greatest, in radians.
    """
    middle = np.array([board.columns * board.square / 2, board.rows * board.square / 2, 0.0])
    out = np.zeros((count, 4, 4))
    for k in range(count):
        # Steps of the golden ratio spread distances and directions evenly, however many there are.
        depth = 0.3 + 0.3 * ((k * 0.618) % 1.0)
        aside = rng.uniform(-0.41, 0.41, 2) * np.array([1.0, size[1] / size[0]]) * depth * (0.4 + depth)
        direction, lean = 2 * np.pi * ((k * 0.382) % 1.0), tilt * rng.uniform(0.55, 1.0)
        R = geometry.so3_exp([lean * np.cos(direction), lean * np.sin(direction), rng.uniform(-0.5, 0.5)])
        out[k] = geometry.transform(R, np.array([aside[0] + 0.04, aside[1], depth]) - R @ middle)
    return out


def framed_poses(count: int, rng: np.random.Generator, board: Board, rig: StereoRig) -> Array:
    """Poses (count, 4, 4) as :func:`simulated_poses`, of any board before any camera.

    Its distance is from where it fills the image's narrower way to twice that.
    """
    sides = np.array([board.columns, board.rows]) * board.square
    slopes = np.array([rig.width, rig.height]) / (2.0 * rig.left.fx)
    nearest = float((sides / (2.0 * slopes)).max())
    out = np.zeros((count, 4, 4))
    for k in range(count):
        depth = nearest * (1.05 + ((k * 0.618) % 1.0))
        free = np.maximum(0.95 * slopes * depth - 0.42 * sides, 0.02 * depth)
        aside, direction = rng.uniform(-1.0, 1.0, 2) * free, 2 * np.pi * ((k * 0.382) % 1.0)
        lean = 0.65 * rng.uniform(0.55, 1.0)
        R = geometry.so3_exp([lean * np.cos(direction), lean * np.sin(direction), rng.uniform(-0.4, 0.4)])
        middle = np.array([*(sides / 2.0), 0.0])
        place = np.array([aside[0] + 0.4 * rig.baseline, aside[1], depth])
        out[k] = geometry.transform(R, place - R @ middle)
    return out


class BoardRenderer:
    """Renders one board as one rig sees it."""

    def __init__(self, rig: StereoRig, board: Board = BOARD) -> None:
        self.rig = rig
        self.board = board
        self._texture = board.draw(_TEXTURE, _TEXTURE // 2).astype(np.float32)
        self._rays = [_rays(lens, rig.width, rig.height) for lens in (rig.left, rig.right)]

    def pair(
        self,
        T_left_board: Array,
        rng: np.random.Generator,
        blur: float = 0.7,
        noise: float = 2.0,
        vignetting: float = 0.0,
    ) -> tuple[Image, Image]:
        """Left and right image (H, W); ``blur`` in pixels and ``noise`` in grey levels are standard deviations.

        ``vignetting`` is the part of the light that the images' corners lack.
        """
        T_right_board = geometry.transform(self.rig.R, self.rig.T) @ T_left_board
        left, right = (
            self._image(rays, T, rng, (blur, noise, vignetting))
            for rays, T in zip(self._rays, (T_left_board, T_right_board), strict=True)
        )
        return left, right

    def pairs(self, count: int, seed: int = 1, blur: float = 0.7, noise: float = 2.0) -> list[tuple[str, Image, Image]]:
        """A set of pairs with their names, in poses of :func:`simulated_poses`."""
        rng = np.random.default_rng(seed)
        poses = simulated_poses(count, rng, self.board, (self.rig.width, self.rig.height))
        return [(f"{k:03d}", *self.pair(T, rng, blur, noise)) for k, T in enumerate(poses)]

    def framed(
        self, count: int, seed: int = 1, blur: float = 0.7, noise: float = 2.0, vignetting: float = 0.0
    ) -> list[tuple[str, Image, Image]]:
        """A set of pairs with their names, in poses of :func:`framed_poses`."""
        rng = np.random.default_rng(seed)
        poses = framed_poses(count, rng, self.board, self.rig)
        return [(f"{k:03d}", *self.pair(T, rng, blur, noise, vignetting)) for k, T in enumerate(poses)]

    def _image(
        self, rays: NDArray[np.float32], T: Array, rng: np.random.Generator, look: tuple[float, float, float]
    ) -> Image:
        blur, noise, vignetting = look
        to_board = np.linalg.inv(np.stack([T[:3, 0], T[:3, 1], T[:3, 3]], axis=1))
        x, y, w = (rays @ to_board.T.astype(np.float32)).transpose(2, 0, 1)
        scale, margin = _TEXTURE / self.board.square, _TEXTURE / 2 - 0.5
        with np.errstate(divide="ignore"):
            u, v = (np.asarray(c / w * scale + margin, dtype=np.float32) for c in (x, y))
        drawn = cv2.remap(self._texture, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=-1.0)
        ink = np.asarray(drawn, dtype=np.float32)
        ground = cv2.resize(rng.uniform(50, 140, (9, 13)).astype(np.float32), (ink.shape[1], ink.shape[0]))
        fine = np.where(ink >= 0.0, _INK + (_PAPER - _INK) / 255.0 * ink, ground)
        image = cv2.resize(fine, (self.rig.width, self.rig.height), interpolation=cv2.INTER_AREA)
        if blur > 0.0:
            image = cv2.GaussianBlur(image, (0, 0), blur)
        if vignetting > 0.0:
            image = image * self._falloff(vignetting)
        return np.clip(np.round(image + rng.normal(0.0, noise, image.shape)), 0, 255).astype(np.uint8)

    def _falloff(self, vignetting: float) -> NDArray[np.float32]:
        """The part of the light (H, W) that arrives: less by the square of the distance from the middle."""
        v, u = np.mgrid[-1.0 : 1.0 : self.rig.height * 1j, -1.0 : 1.0 : self.rig.width * 1j]
        return np.asarray(1.0 - vignetting * (u * u + v * v) / 2.0, dtype=np.float32)


def _rays(lens: Lens, width: int, height: int) -> NDArray[np.float32]:
    """Directions (H, W, 3) of the parts of each pixel: the distortion, of five coefficients, undone by iteration."""
    v, u = np.mgrid[0:height, 0:width].astype(np.float64)
    distorted_x, distorted_y = (u - lens.cx) / lens.fx, (v - lens.cy) / lens.fy
    x, y = distorted_x.copy(), distorted_y.copy()
    k1, k2, p1, p2, k3 = lens.distortion[:5]
    for _ in range(_FIXED_POINT_STEPS):
        r2 = x * x + y * y
        radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
        x, y = (
            (distorted_x - 2 * p1 * x * y - p2 * (r2 + 2 * x * x)) / radial,
            (distorted_y - p1 * (r2 + 2 * y * y) - 2 * p2 * x * y) / radial,
        )
    fine = (width * _OVERSAMPLING, height * _OVERSAMPLING)
    parts = [np.asarray(cv2.resize(c, fine, interpolation=cv2.INTER_CUBIC)) for c in (x, y)]
    return np.stack([*parts, np.ones_like(parts[0])], axis=-1).astype(np.float32)
