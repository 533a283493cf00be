"""How a camera is mounted on the vehicle, from a short figure of eight: its own odometry beside that of the wheels.

While the vehicle moves by ``A`` and its camera by ``B``, ``A X = X B`` holds for the mounting ``X`` (hand-eye
calibration). The vehicle moves in a plane, so that

* the axis that the camera turns about, and its translations are normal to, is the vehicle's z: roll and pitch;
* in that plane, ``(R(phi) - I) t + k p = R(psi) u``, with the camera's turn ``phi`` and translation ``u`` and the
  wheels' translation ``p``: yaw ``psi``, place ``t = (x, y)`` and the wheels' scale ``k`` follow by least squares;
* the height leaves no trace in any motion: it must be measured.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from common import geometry
from services.sensors.calibration.errors import CalibrationError

Array = NDArray[np.float64]

MIN_TURN = np.radians(180.0)
"""Least turn to either side. Turns to one side alone leave the place and the yaw confused."""
MIN_LENGTH = 3.0
"""Least distance to be driven, metres."""
MAX_PLACE_SIGMA, MAX_ANGLE_SIGMA = 0.02, np.radians(0.5)
"""Standard deviations, metres and radians, above which a drive was too short or too rough."""

_SEGMENT_M, _SEGMENT_RAD = 1.0, 0.5
"""A segment ends after this distance or turn: its motion stands out of the noise, and drift does not yet."""
_AGREEMENT = 0.85
"""Least correlation of the camera's turns with those of the wheels."""
_ROUNDS = 5
_ROBUST = 2.5
_MAD_TO_SIGMA = 1.4826


@dataclass(frozen=True, slots=True)
class Mounting:
    """A camera's place on its vehicle.

    Attributes:
        T_vehicle_camera: (4, 4) of the optical frame; its height is the one that was given.
        place_sigma: standard deviation of x and y, metres.
        roll_pitch_sigma, yaw_sigma: standard deviations, radians.
        wheel_scale: what the wheels' distances must be multiplied with to agree with the camera's.
    """

    T_vehicle_camera: Array
    place_sigma: tuple[float, float]
    roll_pitch_sigma: float
    yaw_sigma: float
    wheel_scale: float


def mount(camera_motions: Array, wheel_motions: Array, height: float = 0.0) -> Mounting:
    """The mounting from motions between frames, which must be of the same moments.

    ``camera_motions`` (N, 4, 4) are ``T_before_after`` of the optical frame, metric; ``wheel_motions`` (N, 3) are x and
    y, metres, and the turn, radians, of the vehicle in its own frame before. ``height`` of the camera is in metres.

    Raises:
        CalibrationError: the drive does not determine the mounting, or camera and wheels contradict each other.
    """
    _check_drive(camera_motions, wheel_motions)
    pieces = _segments(wheel_motions)
    segments = np.array([_composed(camera_motions[a:b]) for a, b in pieces])
    up, roll_pitch_sigma = _vertical(segments, wheel_motions, pieces)
    R_level_camera = _levelling(up)
    turns = geometry.so3_log(camera_motions[:, :3, :3]) @ up
    _check_turns(turns, wheel_motions[:, 2])
    u = (segments[:, :3, 3] @ R_level_camera.T)[:, :2]
    driven = [_driven(wheel_motions[a:b, :2], turns[a:b]) for a, b in pieces]
    phi, p = np.array([turn for turn, _ in driven]), np.array([step for _, step in driven])
    x, y, psi, scale, covariance = _planar(phi, p, u)
    R = geometry.so3_exp([0.0, 0.0, psi]) @ R_level_camera
    sigma = np.sqrt(np.diag(covariance))
    found = Mounting(
        geometry.transform(R, [x, y, height]),
        (float(sigma[0]), float(sigma[1])),
        roll_pitch_sigma,
        float(sigma[2]),
        scale,
    )
    _check_result(found)
    return found


def _check_drive(camera_motions: Array, wheel_motions: Array) -> None:
    if camera_motions.shape != (len(wheel_motions), 4, 4) or wheel_motions.shape[1:] != (3,):
        raise CalibrationError(
            f"{len(camera_motions)} motions of the camera are no match for {len(wheel_motions)} of the wheels"
        )
    if not (np.isfinite(wheel_motions).all() and geometry.is_transform(camera_motions, tolerance=1e-4)):
        raise CalibrationError(
            "a motion is not finite, or no rigid one: leave the frames out that odometry was lost in"
        )
    turn, length = wheel_motions[:, 2], float(np.linalg.norm(wheel_motions[:, :2], axis=1).sum())
    left, right = float(turn[turn > 0.0].sum()), float(-turn[turn < 0.0].sum())
    if length < MIN_LENGTH or min(left, right) < MIN_TURN:
        raise CalibrationError(
            f"the drive is {length:.1f} m long and turns {np.degrees(left):.0f} degrees to the left and "
            f"{np.degrees(right):.0f} to the right: drive a figure of eight, {MIN_LENGTH:g} m and half a turn each "
            "way at least"
        )


def _check_turns(camera: Array, wheels: Array) -> None:
    """Turns (N,) about the vertical must be the same for both, but for slip."""
    if np.corrcoef(camera, wheels)[0, 1] < _AGREEMENT:
        raise CalibrationError(
            "the camera does not turn when the wheels do: their motions are of different moments, or of two vehicles"
        )


def _check_result(found: Mounting) -> None:
    place, angle = max(found.place_sigma), max(found.yaw_sigma, found.roll_pitch_sigma)
    if place > MAX_PLACE_SIGMA or angle > MAX_ANGLE_SIGMA:
        raise CalibrationError(
            f"the drive tells the camera's place to {100 * place:.1f} cm and its angles to {np.degrees(angle):.2f} "
            f"degrees, which is not enough ({100 * MAX_PLACE_SIGMA:g} cm and {np.degrees(MAX_ANGLE_SIGMA):g} degrees): "
            "drive longer, with tighter turns, on level ground"
        )
    if not 0.5 < found.wheel_scale < 2.0:
        raise CalibrationError(
            f"the camera drives {found.wheel_scale:.2f} times as far as the wheels: check the wheels' radius, and the "
            "stereo calibration's squares"
        )


def _segments(wheel_motions: Array) -> list[tuple[int, int]]:
    """First and last motion (excluded) of each segment."""
    out, begin, length, turn = [], 0, 0.0, 0.0
    for k, (x, y, w) in enumerate(wheel_motions.tolist()):
        length, turn = length + float(np.hypot(x, y)), turn + w
        if length >= _SEGMENT_M or abs(turn) >= _SEGMENT_RAD:
            out.append((begin, k + 1))
            begin, length, turn = k + 1, 0.0, 0.0
    return out


def _composed(motions: Array) -> Array:
    """One motion (4, 4) of several (N, 4, 4)."""
    T = np.eye(4)
    for motion in motions:
        T = T @ motion
    return T


def _driven(steps: Array, turns: Array) -> tuple[float, Array]:
    """Turn and translation (2,) of a segment: the wheels' steps (N, 2), the camera's turns (N,), which do not slip."""
    heading = np.concatenate([[0.0], np.cumsum(turns)])
    before = heading[:-1]
    c, s = np.cos(before), np.sin(before)
    return float(heading[-1]), np.array(
        [(c * steps[:, 0] - s * steps[:, 1]).sum(), (s * steps[:, 0] + c * steps[:, 1]).sum()]
    )


def _vertical(segments: Array, wheel_motions: Array, pieces: list[tuple[int, int]]) -> tuple[Array, float]:
    """The vehicle's z in the camera's frame (3,), and its standard deviation, radians.

    It minimises what the turns (S, 3) have beside it and what the translations (S, 3) have along it, each in units of
    its own noise; bumps are both.
    """
    turns, steps = geometry.so3_log(segments[:, :3, :3]), segments[:, :3, 3]
    beside = (turns * turns).sum(axis=1)[:, None, None] * np.eye(3) - turns[:, :, None] * turns[:, None, :]
    along = steps[:, :, None] * steps[:, None, :]
    weights = np.ones(len(turns)), np.ones(len(turns))
    for _ in range(_ROUNDS):
        M = (weights[0][:, None, None] * beside).sum(axis=0) + (weights[1][:, None, None] * along).sum(axis=0)
        values, vectors = np.linalg.eigh(M)
        up = vectors[:, 0]
        off = np.linalg.norm(np.cross(turns, up), axis=1), np.abs(steps @ up)
        weights = _weights(off[0]), _weights(off[1])
    wheels = np.array([wheel_motions[a:b, 2].sum() for a, b in pieces])
    up = up if float((turns @ up) @ wheels) > 0.0 else -up
    # In units of the noise, the least curvature across the minimum is that of the worse direction.
    return up, float(1.0 / np.sqrt(max(values[1], 1e-12)))


def _weights(errors: Array) -> Array:
    """Geman-McClure's weights (N,) of absolute errors, over their variance."""
    sigma = max(_MAD_TO_SIGMA * float(np.median(errors)), 1e-6)
    return np.asarray(((_ROBUST * sigma) ** 2 / ((_ROBUST * sigma) ** 2 + errors**2)) ** 2 / sigma**2)


def _levelling(up: Array) -> Array:
    """A rotation (3, 3) from the camera's frame to one whose z is ``up`` and whose x is the view, levelled."""
    view = np.array([0.0, 0.0, 1.0])
    x = view - up * (up @ view)
    if np.linalg.norm(x) < 0.1:
        x = np.array([0.0, -1.0, 0.0]) + up * up[1]
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(up, x), up])


def _planar(phi: Array, p: Array, u: Array) -> tuple[float, float, float, float, Array]:
    """``x, y, psi, k`` and their covariance (4, 4), from turns (S,), the wheels' steps and the camera's (S, 2).

    Divided by k the equation is linear in ``(x, y, cos psi, sin psi) / k``, whose last two tell k.
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
        residuals = J @ solution + p
        weight = _weights(np.linalg.norm(residuals, axis=1))
    scale = 1.0 / float(np.hypot(solution[2], solution[3]))
    x, y, cosine, sine = (float(value) for value in solution * scale)
    psi = float(np.arctan2(sine, cosine))
    # Derivatives of (x, y, psi, k) by the linear solution.
    D = np.zeros((4, 4))
    D[0, 0] = D[1, 1] = scale
    D[:2, 2:] = -scale * np.outer([x, y], [cosine, sine])
    D[2, 2:] = scale * np.array([-sine, cosine])
    D[3, 2:] = -(scale**2) * np.array([cosine, sine])
    believed = weight / weight.max()
    freedom = max(2.0 * float(believed.sum()) - 4.0, 1.0)
    variance = float((weight * (residuals**2).sum(axis=1)).sum()) / freedom
    return x, y, psi, scale, D @ np.linalg.inv(H) @ D.T * variance
