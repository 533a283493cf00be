"""Matrices of three rows, and transforms, in compiled loops."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from common.compiled import kernel

Array = NDArray[np.float64]


@kernel
def innovation_covariance(by_landmark: Array, landmark_covariance: Array, noise: Array, out: Array) -> None:
    """Write ``G P G^T + R`` (3, 3): what the landmark's and the measurement's covariances make of the error."""
    for i in range(3):
        for j in range(i, 3):
            total = noise[i, j]
            for p in range(3):
                for q in range(3):
                    total += by_landmark[i, p] * landmark_covariance[p, q] * by_landmark[j, q]
            out[i, j] = out[j, i] = total


@kernel
def add_quadratic(jacobian: Array, covariance: Array, out: Array) -> None:
    """Add ``J P J^T`` (3, 3) of a Jacobian (3, n) and a covariance (n, n)."""
    n = jacobian.shape[1]
    for i in range(3):
        for j in range(3):
            total = 0.0
            for p in range(n):
                for q in range(n):
                    total += jacobian[i, p] * covariance[p, q] * jacobian[j, q]
            out[i, j] += total


@kernel
def invert3(s: Array, out: Array) -> bool:
    """Write the inverse of a symmetric positive definite matrix (3, 3); False where it is not definite."""
    c00 = s[1, 1] * s[2, 2] - s[1, 2] * s[1, 2]
    c01 = s[0, 2] * s[1, 2] - s[0, 1] * s[2, 2]
    c02 = s[0, 1] * s[1, 2] - s[0, 2] * s[1, 1]
    determinant = s[0, 0] * c00 + s[0, 1] * c01 + s[0, 2] * c02
    if not (determinant > 0.0 and s[0, 0] > 0.0):
        return False
    out[0, 0], out[0, 1], out[0, 2] = c00 / determinant, c01 / determinant, c02 / determinant
    out[1, 1] = (s[0, 0] * s[2, 2] - s[0, 2] * s[0, 2]) / determinant
    out[1, 2] = (s[0, 1] * s[0, 2] - s[0, 0] * s[1, 2]) / determinant
    out[2, 2] = (s[0, 0] * s[1, 1] - s[0, 1] * s[0, 1]) / determinant
    out[1, 0], out[2, 0], out[2, 1] = out[0, 1], out[0, 2], out[1, 2]
    return True


@kernel
def quadratic3(e: Array, information: Array) -> float:
    """``e^T W e`` of a vector (3,) and a symmetric matrix (3, 3)."""
    return float(
        e[0] * (information[0, 0] * e[0] + 2.0 * (information[0, 1] * e[1] + information[0, 2] * e[2]))
        + e[1] * (information[1, 1] * e[1] + 2.0 * information[1, 2] * e[2])
        + information[2, 2] * e[2] * e[2]
    )


@kernel
def perturb(T: Array, xi: Array) -> Array:
    """``exp(xi) T`` for a twist (6,) and a transform (4, 4), as :func:`common.geometry.exp` (Barfoot 8.33)."""
    rx, ry, rz = xi[3], xi[4], xi[5]
    angle2 = rx * rx + ry * ry + rz * rz
    angle = np.sqrt(angle2)
    if angle < 1e-4:
        a, b, c = 1.0 - angle2 / 6.0, 0.5 - angle2 / 24.0, 1.0 / 6.0 - angle2 / 120.0
    else:
        a = np.sin(angle) / angle
        b = 2.0 * np.sin(angle / 2.0) ** 2 / angle2
        c = (angle - np.sin(angle)) / (angle2 * angle)
    s = np.array([[0.0, -rz, ry], [rz, 0.0, -rx], [-ry, rx, 0.0]])
    square = s @ s
    step = np.eye(4)
    step[:3, :3] += a * s + b * square
    step[:3, 3] = (np.eye(3) + b * s + c * square) @ xi[:3]
    return step @ T
