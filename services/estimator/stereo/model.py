"""The measurement model that consensus and solve share.

A landmark's measurement is ``m = (u, v, d)``: its place in the left image and its disparity, in pixels, with nearly
Gaussian noise at every depth, infinity included. A rigid motion acts on it as a projectivity (D. Demirdjian and
R. Horaud, *Motion-egomotion discrimination and motion segmentation from image-pair streams*, CVIU 2000), so that
neither prediction nor derivative ever divides by a disparity.

A camera enters the compiled functions as the array ``[fx, fy, cx, cy, f_x b]``.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from common.camera import StereoCamera
from common.compiled import kernel

Array = NDArray[np.float64]


def intrinsics(camera: StereoCamera) -> Array:
    """The camera as an array, for the functions of this module."""
    return np.array([camera.fx, camera.fy, camera.cx, camera.cy, camera.fx * camera.baseline])


def as_uvd(landmarks: NDArray[np.float32], covariances: NDArray[np.float32], k: Array) -> tuple[Array, Array]:
    """Measurements (N, 3) ``(u, v, d)`` and their covariances (N, 3, 3) of landmarks before the camera ``k``."""
    x, y, z = np.asarray(landmarks, dtype=np.float64).T
    jacobian = np.zeros((len(z), 3, 3))
    jacobian[:, 0, 0], jacobian[:, 1, 1] = k[0] / z, k[1] / z
    jacobian[:, :, 2] = -np.stack([k[0] * x, k[1] * y, np.full_like(z, k[4])], axis=-1) / z[:, None] ** 2
    uvd = np.stack([k[0] * x / z + k[2], k[1] * y / z + k[3], k[4] / z], axis=-1)
    return uvd, jacobian @ np.asarray(covariances, dtype=np.float64) @ jacobian.transpose(0, 2, 1)


@kernel
def predict(m: Array, T: Array, k: Array, out: Array) -> float:
    """Write into ``out`` (3,) the measurement ``(u, v, d)`` of ``m`` seen from the frame that ``T`` takes it to.

    Returns the ratio of the new depth to the old; not positive behind the camera, where ``out`` means nothing.
    """
    x, y, inverse_depth = (m[0] - k[2]) / k[0], (m[1] - k[3]) / k[1], m[2] / k[4]
    qx = T[0, 0] * x + T[0, 1] * y + T[0, 2] + T[0, 3] * inverse_depth
    qy = T[1, 0] * x + T[1, 1] * y + T[1, 2] + T[1, 3] * inverse_depth
    qz = T[2, 0] * x + T[2, 1] * y + T[2, 2] + T[2, 3] * inverse_depth
    out[0], out[1], out[2] = k[0] * qx / qz + k[2], k[1] * qy / qz + k[3], m[2] / qz
    return float(qz)


@kernel
def derivatives(m: Array, T: Array, k: Array, by_pose: Array, by_landmark: Array) -> None:
    """Write the derivatives of :func:`predict` by a left perturbation of ``T`` (3, 6) and by ``m`` (3, 3)."""
    x, y, w = (m[0] - k[2]) / k[0], (m[1] - k[3]) / k[1], m[2] / k[4]
    qx = T[0, 0] * x + T[0, 1] * y + T[0, 2] + T[0, 3] * w
    qy = T[1, 0] * x + T[1, 1] * y + T[1, 2] + T[1, 3] * w
    qz = T[2, 0] * x + T[2, 1] * y + T[2, 2] + T[2, 3] * w
    a, b, c = qx / qz, qy / qz, 1.0 / qz
    # By the homogeneous point (qx, qy, qz): rows (fx c, 0, -fx a c), (0, fy c, -fy b c), (0, 0, -d c c).
    fx, fy, d = k[0], k[1], m[2]
    by_pose[0, 0], by_pose[0, 1], by_pose[0, 2] = fx * c * w, 0.0, -fx * a * c * w
    by_pose[1, 0], by_pose[1, 1], by_pose[1, 2] = 0.0, fy * c * w, -fy * b * c * w
    by_pose[2, 0], by_pose[2, 1], by_pose[2, 2] = 0.0, 0.0, -d * c * c * w
    by_pose[0, 3], by_pose[0, 4], by_pose[0, 5] = -fx * a * b, fx * (1.0 + a * a), -fx * b
    by_pose[1, 3], by_pose[1, 4], by_pose[1, 5] = -fy * (1.0 + b * b), fy * a * b, fy * a
    by_pose[2, 3], by_pose[2, 4], by_pose[2, 5] = -d * c * b, d * c * a, 0.0
    for j in range(3):
        scale = 1.0 / k[0] if j == 0 else (1.0 / k[1] if j == 1 else 1.0 / k[4])
        column = 3 if j == 2 else j
        dx, dy, dz = T[0, column] * scale, T[1, column] * scale, T[2, column] * scale
        by_landmark[0, j] = fx * c * (dx - a * dz)
        by_landmark[1, j] = fy * c * (dy - b * dz)
        by_landmark[2, j] = -d * c * c * dz
    by_landmark[2, 2] += c
