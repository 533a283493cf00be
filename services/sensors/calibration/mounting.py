"""How a camera is mounted on the vehicle, from a short figure of eight: its own odometry beside that of the wheels.

While the vehicle moves by ``A`` and its camera by ``B``, ``A X = X B`` holds for the mounting ``X`` (hand-eye
calibration). Of ``A`` the wheels tell what lies in the plane of the ground; that the vehicle stays on it tells the
rest, but for the camera's height, which leaves no trace in any motion on a plane: it must be measured.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from common import geometry
from services.sensors.calibration.errors import CalibrationError
from services.sensors.calibration.handeye import HandEye, Segments, refine
from services.sensors.calibration.handeye_start import levelling, planar, vertical

Array = NDArray[np.float64]

MIN_TURN = np.radians(180.0)
"""Least turn to either side. Turns to one side alone leave the place and the yaw confused."""
MIN_LENGTH = 3.0
"""Least distance to be driven, metres."""
MAX_PLACE_SIGMA, MAX_ANGLE_SIGMA = 0.02, np.radians(0.8)
"""Standard deviations, metres and radians, above which a drive was too short or too rough."""
MAX_SLIP = 0.4
"""Greatest share of segments on which the wheels may have slipped."""

_SEGMENT_M, _SEGMENT_RAD = 1.0, 0.5
"""A segment ends after this distance or turn: its motion stands out of the noise, and drift does not yet."""
_AGREEMENT = 0.85
"""Least correlation of the camera's turns with those of the wheels."""
_SLIPPED_M, _SLIPPED_RAD, _SLIPPED_PART = 0.05, 0.05, 0.15
"""On a segment on which the wheels slipped they are further off than these metres, or these radians and this part of
the turn, beyond the camera's own noise."""
_OUTLIER = 4.0
_CURVES_M = 0.005
"""Standard deviation of a place beside what the drive's scatter tells: what all curves slip alike shows in none."""
_GOOD_SCALE = 0.05
_GOOD_SLIP = 0.1
_BACKWARDS = np.radians(120.0)


@dataclass(frozen=True, slots=True)
class Mounting:
    """A camera's place on its vehicle.

    Attributes:
        T_vehicle_camera: (4, 4) of the optical frame; its height is the one that was given.
        place_sigma: standard deviation of x and y, metres.
        roll_pitch_sigma, yaw_sigma: standard deviations, radians.
        wheel_scale: what the wheels' distances must be multiplied with to agree with the camera's.
        turn_scale: likewise their turns; the mounting is computed from the camera's turns alone.
        residuals, turn_residuals: (S,) by how much wheels and camera disagree on each segment, metres and radians.
        slipped: (S,) whether they disagree by more than rolling wheels do.
        warnings: what could be better, or may be wrong, a sentence each.
    """

    T_vehicle_camera: Array
    place_sigma: tuple[float, float]
    roll_pitch_sigma: float
    yaw_sigma: float
    wheel_scale: float
    turn_scale: float
    residuals: Array
    turn_residuals: Array
    slipped: NDArray[np.bool_]
    warnings: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Course:
    """What a drive has covered: metres, and radians turned to either side."""

    length: float
    left: float
    right: float

    @classmethod
    def of(cls, wheel_motions: Array) -> Course:
        """Of motions (N, 3)."""
        turn, length = wheel_motions[:, 2], float(np.linalg.norm(wheel_motions[:, :2], axis=1).sum())
        return cls(length, float(turn[turn > 0.0].sum()), float(-turn[turn < 0.0].sum()))

    def __str__(self) -> str:
        """As a person would tell it."""
        left, right = np.degrees(self.left), np.degrees(self.right)
        return f"{self.length:.1f} m, {left:.0f} degrees to the left and {right:.0f} to the right"


def mount(camera_motions: Array, wheel_motions: Array, height: float = 0.0) -> Mounting:
    """The mounting from motions between frames, which must be of the same moments.

    ``camera_motions`` (N, 4, 4) are ``T_before_after`` of the optical frame, metric; ``wheel_motions`` (N, 3) are x and
    y, metres, and the turn, radians, of the vehicle in its own frame before. ``height`` of the camera is in metres.
    Motions may be missing: each pair obeys ``A X = X B`` by itself, and so does what they are composed to.

    Raises:
        CalibrationError: the drive does not determine the mounting, or camera and wheels contradict each other.
    """
    _check_drive(camera_motions, wheel_motions)
    pieces = _segments(wheel_motions)
    wheel_turns = np.array([wheel_motions[a:b, 2].sum() for a, b in pieces])
    # A quarter of a circle errs together: ground and slip are alike from segment to segment.
    clusters = np.floor(np.cumsum(np.abs(wheel_turns)) / (np.pi / 2.0)).astype(np.int64)
    segments = Segments.of(pieces, camera_motions, wheel_motions, np.unique(clusters, return_inverse=True)[1])
    up = vertical(segments.turns, segments.steps, wheel_turns)
    _check_turns(geometry.so3_log(camera_motions[:, :3, :3]) @ up, wheel_motions[:, 2])
    solved = _solve(segments, up, height)
    found = _judged(solved, segments.turns @ up, wheel_turns)
    _check_result(found)
    return found


def _solve(segments: Segments, up: Array, height: float) -> HandEye:
    """The mounting as if the ground were a plane, and refined from there."""
    level = levelling(up)
    in_plane = (segments.steps @ level.T)[:, :2]
    x, y, yaw, scale = planar(segments.turns @ up, segments.driven(level)[:, :2], in_plane)
    return refine(segments, geometry.so3_exp([0.0, 0.0, yaw]) @ level, np.array([x, y, height]), scale)


def _judged(solved: HandEye, turns: Array, wheel_turns: Array) -> Mounting:
    """A solution, and how far wheels and camera agree on segments with the camera's turns and the wheels' (S,)."""
    turn_scale, turn_residuals = _turn_scale(turns, wheel_turns)
    residuals = np.linalg.norm(solved.residuals[:, :2], axis=1)
    _, up_noise, tilt_noise = solved.noises
    slipped = (residuals > _SLIPPED_M + _OUTLIER * up_noise) | (
        np.abs(turn_residuals) > _SLIPPED_RAD + _SLIPPED_PART * np.abs(turns) + _OUTLIER * tilt_noise
    )
    sigma = np.sqrt(np.diag(solved.covariance))
    return Mounting(
        T_vehicle_camera=geometry.transform(solved.X, solved.t),
        place_sigma=(float(np.hypot(sigma[3], _CURVES_M)), float(np.hypot(sigma[4], _CURVES_M))),
        roll_pitch_sigma=float(np.sqrt(np.linalg.eigvalsh(solved.covariance[:2, :2])[-1])),
        yaw_sigma=float(sigma[2]),
        wheel_scale=solved.scale,
        turn_scale=turn_scale,
        residuals=residuals,
        turn_residuals=turn_residuals,
        slipped=slipped,
        warnings=_warnings(solved.X, solved.scale, turn_scale, float(slipped.mean())),
    )


def _check_drive(camera_motions: Array, wheel_motions: Array) -> None:
    if camera_motions.shape != (len(wheel_motions), 4, 4) or wheel_motions.shape[1:] != (3,):
        raise CalibrationError(
            f"{len(camera_motions)} motions of the camera are no match for {len(wheel_motions)} of the wheels"
        )
    if not (np.isfinite(wheel_motions).all() and geometry.is_transform(camera_motions, tolerance=1e-4)):
        raise CalibrationError(
            "a motion is not finite, or no rigid one: leave the frames out that odometry was lost in"
        )
    course = Course.of(wheel_motions)
    if course.length < MIN_LENGTH or min(course.left, course.right) < MIN_TURN:
        raise CalibrationError(
            f"the drive is too little: {course}; drive a figure of eight, {MIN_LENGTH:g} m and half a turn each "
            "way at least"
        )


def _check_turns(camera: Array, wheels: Array) -> None:
    """Turns (N,) about the vertical must be the same for both, but for slip."""
    if np.corrcoef(camera, wheels)[0, 1] < _AGREEMENT:
        raise CalibrationError(
            "the camera does not turn when the wheels do: their motions are of different moments, or of two vehicles"
        )


def _check_result(found: Mounting) -> None:
    share = float(found.slipped.mean())
    if share > MAX_SLIP:
        raise CalibrationError(
            f"wheels and camera disagree on {100 * share:.0f} % of the way, by {100 * np.median(found.residuals):.0f} "
            f"cm and {np.degrees(np.median(np.abs(found.turn_residuals))):.0f} degrees a metre or so: the wheels slip; "
            "drive more slowly, in wider turns, on ground with more grip"
        )
    place, angle = max(found.place_sigma), max(found.yaw_sigma, found.roll_pitch_sigma)
    if place > MAX_PLACE_SIGMA or angle > MAX_ANGLE_SIGMA:
        raise CalibrationError(
            f"the drive tells the camera's place to {100 * place:.1f} cm and its angles to {np.degrees(angle):.1f} "
            f"degrees, which is not enough ({100 * MAX_PLACE_SIGMA:g} cm and {np.degrees(MAX_ANGLE_SIGMA):g} degrees): "
            "drive longer, with tighter turns, on level ground"
        )
    if not 0.5 < found.wheel_scale < 2.0:
        raise CalibrationError(
            f"the camera drives {found.wheel_scale:.2f} times as far as the wheels: check the wheels' radius, and the "
            "stereo calibration's squares"
        )


def _warnings(R_vehicle_camera: Array, wheel_scale: float, turn_scale: float, slipped: float) -> tuple[str, ...]:
    """What could be better, and mountings that a wrong sign of the wheels looks like."""
    out = []
    if R_vehicle_camera[2, 1] > 0.0:
        out.append(
            "the camera is upside down; if it is not, the wheels' turn rate has the wrong sign: left is positive"
        )
    if abs(np.arctan2(R_vehicle_camera[1, 2], R_vehicle_camera[0, 2])) > _BACKWARDS:
        out.append("the camera looks backwards; if it does not, the wheels' speed has the wrong sign")
    for scale, what in ((wheel_scale, "distances"), (turn_scale, "turns")):
        if abs(scale - 1.0) > _GOOD_SCALE:
            out.append(f"the wheels' {what} are {1 / scale:.2f} times the camera's: correct them in the base's driver")
    if slipped > _GOOD_SLIP:
        out.append(f"the wheels slip on {100 * slipped:.0f} % of the way: drive more slowly, or on other ground")
    return tuple(out)


def _turn_scale(phi: Array, wheel_turns: Array) -> tuple[float, Array]:
    """The ratio of the camera's turns (S,) to those of the wheels, and what remains (S,); slip does not move it."""
    turning = np.abs(phi) > 0.5 * _SEGMENT_RAD
    ratios = phi[turning] / np.where(wheel_turns[turning] == 0.0, np.inf, wheel_turns[turning])
    scale = float(np.median(ratios)) if turning.any() else 1.0
    return scale, phi - scale * wheel_turns


def _segments(wheel_motions: Array) -> list[tuple[int, int]]:
    """First and last motion (excluded) of each segment."""
    out, begin, length, turn = [], 0, 0.0, 0.0
    for k, (x, y, w) in enumerate(wheel_motions.tolist()):
        length, turn = length + float(np.hypot(x, y)), turn + w
        if length >= _SEGMENT_M or abs(turn) >= _SEGMENT_RAD:
            out.append((begin, k + 1))
            begin, length, turn = k + 1, 0.0, 0.0
    return out
