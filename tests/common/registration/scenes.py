"""Pictures of known shift: windows onto a wide scene of trunks, walls, crowns and a skyline."""

import cv2
import numpy as np

WIDTH, HEIGHT = 512, 192


def panorama(seed=0, width=1400, height=HEIGHT):
    """A wide grey scene (height, width): sky above a skyline, trunks, boxes and a textured ground."""
    random = np.random.default_rng(seed)
    skyline = height * (0.35 + 0.1 * cv2.GaussianBlur(random.normal(size=(1, width)), (0, 0), 12)[0] * 5)
    rows = np.arange(height)[:, None]
    scene = np.where(rows < skyline, 210.0, 110.0)
    for _ in range(width // 12):
        x, wide = int(random.integers(width)), int(random.integers(2, 14))
        top, tall = int(random.integers(height * 3 // 4)), int(random.integers(20, height // 2))
        scene[top : top + tall, x : x + wide] = random.uniform(20, 235)
    texture = cv2.GaussianBlur(random.normal(size=(height, width)), (0, 0), 1.5) * 25
    return np.clip(cv2.GaussianBlur(scene + texture, (0, 0), 0.8), 0, 255)


def window(scene, left, width=WIDTH, top=0, height=HEIGHT):
    """The part of a scene that starts at ``left`` pixels, a fraction included, as an image."""
    move = np.array([[1.0, 0.0, -left], [0.0, 1.0, -top]])
    moved = cv2.warpAffine(scene, move, (width, height), flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT)
    return np.clip(moved, 0, 255).astype(np.uint8)
