"""Hand-eye calibration of a camera on a vehicle whose wheels tell how far it drives, not how the ground lies.

With the camera's turn ``R_B`` and translation ``u`` on a segment of the drive, the vehicle has turned by
``R_A = X R_B X'`` and moved by ``k p``, its wheels' steps each turned by what it had turned before. The mounting's
rotation ``X`` and place ``t``, and the wheels' scale ``k`` make

* ``X u = k p + (R_A - I) t``: on the plane by the wheels, along z as a vehicle stays on the ground it stands on;
* the turns be about z, up to what the ground bends.

Ground that is a bowl tilts what is seen of both by one angle all around a circle, which is why the vehicle's whole
turns are taken, not their part about z.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from common import geometry
from services.sensors.calibration.errors import CalibrationError
from services.sensors.calibration.handeye_start import believed, noise

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

_ITERATIONS = 12
_STEP = 1e-6
_CONVERGED = 1e-8
_INDEPENDENT = 4
"""Clusters that count as independent at most: further laps are over the same ground."""
_KINDS = ((0, 2), (2, 3), (3, 5))
"""Columns of the residuals whose noise is one: across the plane by the wheels, along z, turns beside z."""


@dataclass(frozen=True, slots=True)
class Segments:
    """A drive cut into S segments of N motions.

    Attributes:
        starts: (S,) index of each one's first motion.
        turned: (N, 3, 3) what the camera has turned within the segment before each motion.
        rotations: (S, 3, 3) of the camera on each; ``turns``: (S, 3) the same as vectors, radians.
        steps: (S, 3) its translations, metres.
        wheel_steps: (N, 3) the wheels' steps in the vehicle's frame before each; their z is 0.
        clusters: (S,) numbers of those that err together, from 0 on.
    """

    starts: Ints
    turned: Array
    rotations: Array
    turns: Array
    steps: Array
    wheel_steps: Array
    clusters: Ints

    @classmethod
    def of(cls, pieces: list[tuple[int, int]], camera: Array, wheels: Array, clusters: Ints) -> Segments:
        """Of motions (N, 4, 4) and (N, 3) in pieces (first and one past the last) that follow each other."""
        turned, T = np.zeros((pieces[-1][1], 3, 3)), np.zeros((len(pieces), 4, 4))
        for k, (a, b) in enumerate(pieces):
            motion = np.eye(4)
            for j in range(a, b):
                turned[j] = motion[:3, :3]
                motion = motion @ camera[j]
            T[k] = motion
        steps = np.pad(wheels[: pieces[-1][1], :2], ((0, 0), (0, 1)))
        R = T[:, :3, :3]
        return cls(np.array([a for a, _ in pieces]), turned, R, geometry.so3_log(R), T[:, :3, 3], steps, clusters)

    def driven(self, X: Array) -> Array:
        """The wheels' translations ``p`` (S, 3) by a camera that is turned by ``X`` (3, 3) on the vehicle."""
        steps = np.einsum("ij,njk,lk,nl->ni", X, self.turned, X, self.wheel_steps)
        return np.asarray(np.add.reduceat(steps, self.starts))


@dataclass(frozen=True, slots=True)
class HandEye:
    """A mounting: rotation ``X`` (3, 3) and place ``t`` (3,) of the camera, and the wheels' scale.

    ``covariance`` (6, 6) is of rotation (on the left, in the vehicle's frame), x, y and scale. ``residuals`` (S, 5) are
    metres along x, y and z, and radians about x and y. ``noises`` (3,) are standard deviations by :data:`_KINDS`.
    """

    X: Array
    t: Array
    scale: float
    covariance: Array
    residuals: Array
    noises: Array


def refine(drive: Segments, X: Array, t: Array, scale: float) -> HandEye:
    """Robust least squares over all segments from a first guess; the place's height stays as it is.

    Raises:
        CalibrationError: the drive does not tell the mounting.
    """
    for _ in range(_ITERATIONS):
        r = _residuals(drive, X, t, scale)
        J, weights = _jacobian(drive, X, t, scale), _weights(r)
        H = np.einsum("ni,nij,nik->jk", weights, J, J)
        if not np.isfinite(H).all() or np.linalg.cond(H) > 1e14:
            raise CalibrationError("the drive does not tell the camera's place: drive a figure of eight")
        step = np.linalg.solve(H, -np.einsum("ni,nij,ni->j", weights, J, r))
        X, t, scale = _moved(X, t, scale, step)
        if np.abs(step).max() < _CONVERGED:
            break
    r = _residuals(drive, X, t, scale)
    J, weights = _jacobian(drive, X, t, scale), _weights(r)
    H, pulls = np.einsum("ni,nij,nik->jk", weights, J, J), np.einsum("ni,nij,ni->nj", weights, J, r)
    noises = np.array([_noise(r, *kind) for kind in _KINDS])
    return HandEye(X, t, scale, _covariance(H, pulls, drive.clusters), r, noises)


def _residuals(drive: Segments, X: Array, t: Array, scale: float) -> Array:
    """(S, 5); see :class:`HandEye`."""
    R_A = X @ drive.rotations @ X.T
    moved = drive.steps @ X.T - scale * drive.driven(X) - (R_A - np.eye(3)) @ t
    return np.column_stack([moved, (drive.turns @ X.T)[:, :2]])


def _jacobian(drive: Segments, X: Array, t: Array, scale: float) -> Array:
    """Derivatives (S, 5, 6) of the residuals, by central differences."""
    J = np.zeros((len(drive.starts), 5, 6))
    for k, step in enumerate(_STEP * np.eye(6)):
        ahead, behind = (_residuals(drive, *_moved(X, t, scale, sign * step)) for sign in (1.0, -1.0))
        J[:, :, k] = (ahead - behind) / (2.0 * _STEP)
    return J


def _moved(X: Array, t: Array, scale: float, step: Array) -> tuple[Array, Array, float]:
    return geometry.so3_exp(step[:3]) @ X, t + np.array([step[3], step[4], 0.0]), scale + float(step[5])


def _weights(r: Array) -> Array:
    """Weights (S, 5) of the residuals, each kind in units of its own noise."""
    out = np.empty_like(r)
    for a, b in _KINDS:
        size = np.linalg.norm(r[:, a:b], axis=1)
        out[:, a:b] = (believed(size) / _noise(r, a, b) ** 2)[:, None]
    return out


def _noise(r: Array, a: int, b: int) -> float:
    """Standard deviation of each of some columns of the residuals (S, 5)."""
    return noise(np.abs(r[:, a:b]).ravel())


def _covariance(H: Array, pulls: Array, clusters: Ints) -> Array:
    """Covariance (n, n) of a solution of normal matrix ``H`` in units of the noise.

    Slip and the ground's bends err alike from segment to segment. ``pulls`` (S, n), the gradients, scatter by clusters
    of segments (the sandwich estimator), so in each direction the larger one of both answers holds.
    """
    alone = np.linalg.inv(H)
    count = int(clusters.max()) + 1
    sums = np.zeros((count, len(H)))
    np.add.at(sums, clusters, pulls)
    repeated = count / max(count - 1, 1) * max(1.0, count / _INDEPENDENT)
    together = alone @ (sums.T @ sums * repeated) @ alone
    # In the coordinates in which one is the identity, the larger of both is that of the eigenvalues.
    L = np.linalg.cholesky(alone)
    inverse = np.linalg.inv(L)
    values, vectors = np.linalg.eigh(inverse @ together @ inverse.T)
    return np.asarray(L @ (vectors * np.maximum(values, 1.0)) @ vectors.T @ L.T)
