"""SE(3) as 4x4 arrays, and transforms that carry a covariance.

Conventions (Barfoot, *State Estimation for Robotics*, 2nd ed., chapter 8):

* ``T_a_b`` takes coordinates in frame b to coordinates in frame a.
* A twist is ``xi = [rho, phi]``: translation first, then rotation, each in radians or metres.
* A perturbation is on the left: ``T = exp(xi) @ T_mean``; a covariance is that of ``xi``.

Every function takes stacked input: a leading shape ``(...)`` is carried through.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

_SMALL_ANGLE = 1e-4
"""Below this angle (rad) the series of the coefficients beats their closed forms in double precision."""


_EYE3 = np.eye(3)
_LAST_ROW = np.array([0.0, 0.0, 0.0, 1.0])


def skew(v: ArrayLike) -> Array:
    """Matrices ``v^`` of shape (..., 3, 3) with ``v^ u = v x u``, for vectors of shape (..., 3)."""
    v = np.asarray(v, dtype=np.float64)
    out = np.zeros((*v.shape[:-1], 3, 3))
    out[..., 0, 1], out[..., 0, 2] = -v[..., 2], v[..., 1]
    out[..., 1, 0], out[..., 1, 2] = v[..., 2], -v[..., 0]
    out[..., 2, 0], out[..., 2, 1] = -v[..., 1], v[..., 0]
    return out


def _coefficients(angle: Array) -> tuple[Array, Array, Array]:
    """``sin(a)/a``, ``(1 - cos(a))/a^2`` and ``(a - sin(a))/a^3``, stable near zero."""
    small = angle < _SMALL_ANGLE
    a = np.where(small, 1.0, angle)
    a2 = angle * angle
    first = np.where(small, 1.0 - a2 / 6.0, np.sin(a) / a)
    # 2 sin^2(a/2) instead of 1 - cos(a): the difference loses half of the digits at small angles.
    second = np.where(small, 0.5 - a2 / 24.0, 2.0 * np.sin(a / 2.0) ** 2 / (a * a))
    third = np.where(small, 1.0 / 6.0 - a2 / 120.0, (a - np.sin(a)) / (a * a * a))
    return first, second, third


def _norm(v: Array) -> Array:
    return np.asarray(np.sqrt((v * v).sum(-1)))


def _exp(phi: Array) -> tuple[Array, Array]:
    """Rotation matrices (..., 3, 3) and left Jacobians of SO(3) (..., 3, 3) (Barfoot 8.7 and 8.34)."""
    a, b, c = (coefficient[..., None, None] for coefficient in _coefficients(_norm(phi)))
    s = skew(phi)
    s2 = s @ s
    return np.asarray(_EYE3 + a * s + b * s2), np.asarray(_EYE3 + b * s + c * s2)


def so3_exp(phi: ArrayLike) -> Array:
    """Rotation matrices (..., 3, 3) of rotation vectors (..., 3) in radians (Barfoot 8.7, Rodrigues)."""
    return _exp(np.asarray(phi, dtype=np.float64))[0]


def _quaternion_rows() -> Array:
    """The (9, 16) matrix that takes a rotation's entries to those of ``4 q q^T - I``, q = (w, x, y, z)."""
    rows = np.zeros((3, 3, 4, 4))
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        rows[i, i] = np.diag([1.0, -1.0, -1.0, -1.0])
        rows[i, i, i + 1, i + 1] = 1.0
        rows[k, j, 0, i + 1] = rows[k, j, i + 1, 0] = 1.0
        rows[j, k, 0, i + 1] = rows[j, k, i + 1, 0] = -1.0
        for a, b in ((i, j), (j, i)):
            rows[a, b, i + 1, j + 1] = rows[a, b, j + 1, i + 1] = 1.0
    return rows.reshape(9, 16)


_QUATERNION_ROWS = _quaternion_rows()
_EYE4 = np.eye(4).ravel()


def so3_log(rotation: ArrayLike) -> Array:
    """Rotation vectors (..., 3), of angle at most pi, of rotation matrices (..., 3, 3).

    Goes through the quaternion of Shepperd's method, which is stable at every angle, pi included.
    """
    r = np.asarray(rotation, dtype=np.float64)
    # Row k holds 4 * q_k * (w, x, y, z); the row of the largest q_k is divided by its own length.
    rows = (r.reshape(*r.shape[:-2], 9) @ _QUATERNION_ROWS + _EYE4).reshape(*r.shape[:-2], 4, 4)
    best = np.argmax(np.einsum("...ii->...i", rows), axis=-1)
    q = np.take_along_axis(rows, best[..., None, None], axis=-2)[..., 0, :]
    q = q / _norm(q)[..., None]
    q = np.where(q[..., :1] < 0.0, -q, q)
    sine = _norm(q[..., 1:])
    angle = 2.0 * np.arctan2(sine, q[..., 0])
    tiny = sine < 1e-12
    scale = np.where(tiny, 2.0, angle / np.where(tiny, 1.0, sine))
    return np.asarray(scale[..., None] * q[..., 1:])


def _left_jacobian_inverse(phi: Array) -> Array:
    """Inverse of the left Jacobian of SO(3), (..., 3, 3), for angles below two pi (Barfoot 8.36)."""
    angle = _norm(phi)
    a, b, _ = _coefficients(angle)
    a2 = angle * angle
    small = angle < _SMALL_ANGLE
    square = np.where(small, 1.0 / 12.0 + a2 / 720.0, (1.0 - 0.5 * a / b) / np.where(small, 1.0, a2))
    s = skew(phi)
    return np.asarray(_EYE3 - 0.5 * s + square[..., None, None] * (s @ s))


def transform(rotation: ArrayLike, translation: ArrayLike) -> Array:
    """Transforms (..., 4, 4) of rotation matrices (..., 3, 3) and translations (..., 3)."""
    rotation, translation = np.asarray(rotation, dtype=np.float64), np.asarray(translation, dtype=np.float64)
    out = np.zeros((*np.broadcast_shapes(rotation.shape[:-2], translation.shape[:-1]), 4, 4))
    out[..., :3, :3], out[..., :3, 3], out[..., 3, 3] = rotation, translation, 1.0
    return out


def exp(xi: ArrayLike) -> Array:
    """Transforms (..., 4, 4) of twists (..., 6) (Barfoot 8.33)."""
    xi = np.asarray(xi, dtype=np.float64)
    rotation, jacobian = _exp(xi[..., 3:])
    return transform(rotation, (jacobian @ xi[..., :3, None])[..., 0])


def log(T: ArrayLike) -> Array:
    """Twists (..., 6) of transforms (..., 4, 4), inverse of :func:`exp` for angles below pi."""
    T = np.asarray(T, dtype=np.float64)
    phi = so3_log(T[..., :3, :3])
    rho = (_left_jacobian_inverse(phi) @ T[..., :3, 3:])[..., 0]
    return np.concatenate([rho, phi], axis=-1)


def inverse(T: ArrayLike) -> Array:
    """``T_b_a`` of ``T_a_b``, shapes (..., 4, 4), without a general matrix inversion."""
    T = np.asarray(T, dtype=np.float64)
    rotation = np.swapaxes(T[..., :3, :3], -1, -2)
    return transform(rotation, -(rotation @ T[..., :3, 3:])[..., 0])


def adjoint(T: ArrayLike) -> Array:
    """Adjoints (..., 6, 6): ``exp(Ad(T) xi) = T exp(xi) T^-1`` (Barfoot 8.44)."""
    T = np.asarray(T, dtype=np.float64)
    out = np.zeros((*T.shape[:-2], 6, 6))
    out[..., :3, :3] = out[..., 3:, 3:] = T[..., :3, :3]
    out[..., :3, 3:] = skew(T[..., :3, 3]) @ T[..., :3, :3]
    return out


def apply(T: ArrayLike, points: ArrayLike) -> Array:
    """Points (..., N, 3) of frame b in frame a, by ``T_a_b`` (..., 4, 4)."""
    T = np.asarray(T, dtype=np.float64)
    p = np.asarray(points, dtype=np.float64)
    return np.asarray(p @ np.swapaxes(T[..., :3, :3], -1, -2) + T[..., None, :3, 3])


def normalize(T: ArrayLike) -> Array:
    """The transform nearest to ``T`` (..., 4, 4) whose rotation is a proper rotation (by SVD)."""
    T = np.asarray(T, dtype=np.float64)
    u, _, vt = np.linalg.svd(T[..., :3, :3])
    u[..., :, 2] *= np.linalg.det(u @ vt)[..., None]
    return transform(u @ vt, T[..., :3, 3])


def is_transform(T: ArrayLike, tolerance: float = 1e-6) -> bool:
    """Whether every matrix of ``T`` (..., 4, 4) is a finite rigid transform within ``tolerance``."""
    T = np.asarray(T, dtype=np.float64)
    if T.shape[-2:] != (4, 4) or not np.isfinite(T).all():
        return False
    rotation = T[..., :3, :3]
    # Numbers far from those of a rotation would overflow below.
    if np.abs(T[..., 3, :] - _LAST_ROW).max(initial=0.0) > tolerance or np.abs(rotation).max(initial=0.0) > 2.0:
        return False
    residual = rotation @ np.swapaxes(rotation, -1, -2) - _EYE3
    return bool(np.abs(residual).max(initial=0.0) <= tolerance and (np.linalg.det(rotation) > 0.0).all())


def from_xy_yaw(x: float, y: float, yaw: float) -> Array:
    """The transform (4, 4) of a pose in the plane: metres, metres, radians about z."""
    return transform(so3_exp([0.0, 0.0, yaw]), [x, y, 0.0])


def yaw_of(T: ArrayLike) -> Array:
    """Heading about z, radians, shape (...), of transforms (..., 4, 4)."""
    T = np.asarray(T, dtype=np.float64)
    return np.asarray(np.arctan2(T[..., 1, 0], T[..., 0, 0]))


def arclength(path: ArrayLike) -> Array:
    """Metres (N,) along a path of poses (N, 4, 4), 0 at the first."""
    steps = np.linalg.norm(np.diff(np.asarray(path, dtype=np.float64)[:, :3, 3], axis=0), axis=1)
    return np.concatenate([[0.0], np.cumsum(steps)])


def rotation_angle(T: ArrayLike) -> Array:
    """Angle of the rotation, radians in [0, pi], shape (...), of transforms (..., 4, 4)."""
    return np.asarray(np.linalg.norm(so3_log(np.asarray(T)[..., :3, :3]), axis=-1))


@dataclass(frozen=True, slots=True)
class Uncertain:
    """A transform ``T_a_b`` (4, 4) with the covariance (6, 6) of its left perturbation, in frame a.

    ``a @ b`` composes to first order, the two taken as independent (Barfoot and Furgale,
    *Associating uncertainty with three-dimensional poses*, eq. 36 without its fourth-order terms).
    """

    T: Array
    covariance: Array

    @classmethod
    def identity(cls) -> Self:
        """The identity, known exactly."""
        return cls(np.eye(4), np.zeros((6, 6)))

    @classmethod
    def exactly(cls, T: ArrayLike) -> Self:
        """``T`` with no uncertainty."""
        return cls(np.array(T, dtype=np.float64), np.zeros((6, 6)))

    def inverse(self) -> Uncertain:
        """``T_b_a`` with its covariance, in frame b."""
        T = inverse(self.T)
        Ad = adjoint(T)
        return Uncertain(T, Ad @ self.covariance @ Ad.T)

    def __matmul__(self, other: Uncertain) -> Uncertain:
        """``T_a_c`` of ``T_a_b @ T_b_c``."""
        Ad = adjoint(self.T)
        return Uncertain(self.T @ other.T, self.covariance + Ad @ other.covariance @ Ad.T)

    def mahalanobis2(self, other: Uncertain) -> float:
        """Squared Mahalanobis distance, 6 degrees of freedom, of two independent estimates of one transform."""
        error = log(self.T @ inverse(other.T))
        return float(error @ np.linalg.solve(self.covariance + other.covariance, error))


_WEIGHTS = np.linspace(0.0, 1.0, 41)[:, None, None]


def covariance_intersection(a: Uncertain, b: Uncertain) -> Uncertain:
    """One estimate of a transform from two whose errors are correlated in an unknown way.

    S. Julier and J. Uhlmann, *A non-divergent estimation algorithm in the presence of unknown correlations*, ACC 1997:
    ``P^-1 = w A^-1 + (1 - w) B^-1`` with the w in [0, 1] that makes the determinant of P least. It never claims to know
    more than both say for sure, however often the same evidence comes in.
    """
    information_a, information_b = np.linalg.inv(a.covariance), np.linalg.inv(b.covariance)
    candidates = _WEIGHTS * information_a + (1.0 - _WEIGHTS) * information_b
    best = int(np.argmax(np.linalg.slogdet(candidates)[1]))
    covariance = np.linalg.inv(candidates[best])
    gain = covariance @ information_b * (1.0 - float(_WEIGHTS[best, 0, 0]))
    return Uncertain(exp(gain @ log(b.T @ inverse(a.T))) @ a.T, covariance)
