"""The demo's route: a closed curve with left and right bends, driven once around but for a gap."""

from __future__ import annotations

import numpy as np

from common.geometry import Array

_GAP = 3.0
"""What is left open between the route's end and its start, metres, so that its end is no second start."""
_STEP = 0.1


def waisted_loop(length: float) -> Array:
    """Poses (N, 3) ``[x, y, yaw]``, 0.1 m apart, over ``length`` metres of a loop with a narrow waist.

    The loop is ``r(a) = 1 + 0.27 cos 2a + 0.06 sin 3a``, scaled: its lobes bend left, its waist bends right.
    """
    angle = np.linspace(0.0, 2.0 * np.pi, 20001)
    radius = 1.0 + 0.27 * np.cos(2.0 * angle) + 0.06 * np.sin(3.0 * angle)
    curve = radius[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    travelled = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(curve, axis=0), axis=-1))])
    scale = (length + _GAP) / travelled[-1]
    s = np.arange(0.0, length + 1e-9, _STEP)
    xy = np.stack([np.interp(s, travelled * scale, curve[:, k] * scale) for k in (0, 1)], axis=-1)
    tangent = np.gradient(xy, _STEP, axis=0)
    return np.column_stack([xy, np.unwrap(np.arctan2(tangent[:, 1], tangent[:, 0]))])


def curvature(route: Array) -> Array:
    """Curvature (N,), 1/m, left positive, of evenly spaced poses (N, 3)."""
    step = np.linalg.norm(np.diff(route[:, :2], axis=0), axis=-1).mean()
    return np.asarray(np.gradient(route[:, 2]) / step)
