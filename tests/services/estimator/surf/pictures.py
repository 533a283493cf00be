"""Images to find features in: one generated, one that ships with matplotlib, and real ones where they are at hand."""

from __future__ import annotations

import cv2
import matplotlib.cbook
import numpy as np


def texture(seed, shape=(240, 320)):
    """Blobs of all sizes: noise of several octaves, each as strong as the others; its edges go on at the other side."""
    rng = np.random.default_rng(seed)
    total = np.zeros(shape)
    for sigma in (1.0, 2.0, 4.0, 8.0):
        noise = np.pad(rng.normal(size=shape), 40, mode="wrap")
        smooth = cv2.GaussianBlur(noise, (0, 0), sigma)[40:-40, 40:-40]
        total += smooth / smooth.std()
    return np.clip(128 + 25 * total, 0, 255).astype(np.uint8)


def photograph():
    """A portrait, 512x600."""
    file = matplotlib.cbook.get_sample_data("grace_hopper.jpg", asfileobj=False)
    return cv2.imread(str(file), cv2.IMREAD_GRAYSCALE)


def blob(shape, x, y, sigma, height=150.0, ground=50.0):
    """A Gaussian spot."""
    rows, columns = np.mgrid[: shape[0], : shape[1]]
    spot = np.exp(-((columns - x) ** 2 + (rows - y) ** 2) / (2 * sigma**2))
    return np.clip(np.rint(ground + height * spot), 0, 255).astype(np.uint8)
