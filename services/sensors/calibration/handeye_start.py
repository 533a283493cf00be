"""Where a hand-eye calibration begins: as if the ground were a plane, both problems are of linear algebra.

Both are robust by Geman-McClure's weights, whose scale is the median of the residuals.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from services.sensors.calibration.errors import CalibrationError

Array = NDArray[np.float64]

_ROUNDS = 5
_ROBUST = 2.5
_MAD_TO_SIGMA = 1.4826
_LEAST_NOISE = 1e-6


def noise(errors: Array) -> float:
    """Standard deviation of absolute errors (N,), whatever the outliers among them."""
    return max(float(_MAD_TO_SIGMA * np.median(errors)), _LEAST_NOISE)


def believed(errors: Array) -> Array:
    """Geman-McClure's weights (N,), from 0 to 1, of absolute errors."""
    limit = (_ROBUST * noise(errors)) ** 2
    return np.asarray((limit / (limit + errors**2)) ** 2)


def vertical(turns: Array, steps: Array, wheel_turns: Array) -> Array:
    """The vehicle's z (3,) in the camera's frame, from its turns and translations (S, 3) on segments of the drive.

    It minimises what the turns have beside it and what the translations have along it, each in units of its own noise.
    The wheels' turns (S,) tell up from down.
    """
    beside = (turns * turns).sum(axis=1)[:, None, None] * np.eye(3) - turns[:, :, None] * turns[:, None, :]
    along = steps[:, :, None] * steps[:, None, :]
    weights = np.ones(len(turns)), np.ones(len(turns))
    for _ in range(_ROUNDS):
        M = (weights[0][:, None, None] * beside).sum(axis=0) + (weights[1][:, None, None] * along).sum(axis=0)
        up = np.linalg.eigh(M)[1][:, 0]
        off = np.linalg.norm(np.cross(turns, up), axis=1), np.abs(steps @ up)
        weights = believed(off[0]) / noise(off[0]) ** 2, believed(off[1]) / noise(off[1]) ** 2
    return np.asarray(up if float((turns @ up) @ wheel_turns) > 0.0 else -up)


def levelling(up: Array) -> Array:
    """A rotation (3, 3) from the camera's frame to one whose z is ``up`` and whose x is the view, levelled."""
    view = np.array([0.0, 0.0, 1.0])
    x = view - up * (up @ view)
    if np.linalg.norm(x) < 0.1:
        x = np.array([0.0, -1.0, 0.0]) + up * up[1]
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(up, x), up])


def planar(phi: Array, p: Array, u: Array) -> tuple[float, float, float, float]:
    """Place, yaw ``psi`` and scale ``k`` from turns (S,), the wheels' steps and the camera's (S, 2).

    Divided by k the equation is linear in ``(x, y, cos psi, sin psi) / k``, whose last two tell k.

    Raises:
        CalibrationError: the turns do not tell them.
    """
    c, s = np.cos(phi), np.sin(phi)
    J = np.zeros((len(phi), 2, 4))
    J[:, 0, 0], J[:, 0, 1], J[:, 1, 0], J[:, 1, 1] = c - 1.0, -s, s, c - 1.0
    J[:, 0, 2], J[:, 0, 3], J[:, 1, 2], J[:, 1, 3] = -u[:, 0], u[:, 1], -u[:, 1], -u[:, 0]
    weight = np.ones(len(phi))
    for _ in range(_ROUNDS):
        H = np.einsum("n,nij,nik->jk", weight, J, J)
        if np.linalg.cond(H) > 1e12:
            raise CalibrationError("the drive does not tell the camera's place: drive a figure of eight")
        solution = np.linalg.solve(H, -np.einsum("n,nij,ni->j", weight, J, p))
        weight = believed(np.linalg.norm(J @ solution + p, axis=1))
    scale = 1.0 / float(np.hypot(solution[2], solution[3]))
    x, y, cosine, sine = (float(value) for value in solution * scale)
    return x, y, float(np.arctan2(sine, cosine)), scale
