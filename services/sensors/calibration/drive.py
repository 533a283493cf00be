"""A drive for the mounting: motions of the camera, and those of the wheels between the same moments."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from services.sensors.calibration.errors import CalibrationError
from services.sensors.calibration.wheels import Stamps, WheelLog, find_delay

Array = NDArray[np.float64]

_MIN_SEEN = 0.7
"""Least share of frames between which the camera's motion is known."""
_GOOD_DELAY_S = 0.05


@dataclass(frozen=True, slots=True)
class Seen:
    """The camera's motion between two frames: their stamps, nanoseconds, and ``T_before_after`` (4, 4)."""

    before_ns: int
    after_ns: int
    T_before_after: Array


@dataclass(frozen=True, slots=True)
class Drive:
    """Motions of camera and wheels, both known.

    Attributes:
        before_ns, after_ns: (N,) moments between which they are.
        camera_motions: (N, 4, 4) of the optical frame; ``wheel_motions``: (N, 3) of the vehicle: x, y, turn.
        delay: by how much later the wheels' stamps are than the frames', seconds; it is taken account of.
        frames: of the drive, whether used or not.
        warnings: what could be better, a sentence each.
    """

    before_ns: Stamps
    after_ns: Stamps
    camera_motions: Array
    wheel_motions: Array
    delay: float
    frames: int
    warnings: tuple[str, ...]


def join(seen: Sequence[Seen], frames: int, log: WheelLog) -> Drive:
    """The drive of a camera that moved as ``seen`` between some of its ``frames``, and of its wheels.

    Raises:
        CalibrationError: they have too little in common.
    """
    if frames < 2:
        raise CalibrationError("there are no stereo frames: somebody has to publish sensor/stereo")
    if len(seen) < _MIN_SEEN * (frames - 1):
        raise CalibrationError(
            f"the camera's motion is known between {len(seen)} of {frames} frames alone: drive slowly, in a place with "
            "texture and light"
        )
    before, after = (
        np.array([getattr(motion, name) for motion in seen], dtype=np.int64) for name in ("before_ns", "after_ns")
    )
    motions = np.array([motion.T_before_after for motion in seen])
    delay = find_delay(log, before, after, motions)
    wheels, covered = log.motions(before, after, delay)
    if covered.sum() < _MIN_SEEN * len(seen):
        raise CalibrationError(
            f"the wheels report during {covered.sum()} of {len(seen)} of the camera's motions alone: let the same "
            "clock stamp both, without gaps"
        )
    return Drive(before[covered], after[covered], motions[covered], wheels[covered], delay, frames, _warnings(delay))


def _warnings(delay: float) -> tuple[str, ...]:
    if abs(delay) <= _GOOD_DELAY_S:
        return ()
    later, earlier = ("wheels'", "frames'") if delay > 0.0 else ("frames'", "wheels'")
    return (
        f"the {later} stamps are {1e3 * abs(delay):.0f} ms later than the {earlier}: correct it where they are made",
    )
