"""What odometry says about a frame, be it a stereo pair or a lidar's scan."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Generic, TypeVar

from common.geometry import Array, Uncertain

Frame = TypeVar("Frame")


@dataclass(frozen=True, slots=True)
class OdometryResult(Generic[Frame]):
    """All transforms are between frames of the sensor: left optical ones, or the lidar's.

    Attributes:
        stamp_ns: of the frame.
        success: whether the motion was measured; if not, every transform is the prior's, its covariance grown.
        reason: why not, in one sentence; empty on success.
        T_odom_live: (4, 4), live frame in that of the first.
        T_previous_live: motion since the frame processed before, with covariance.
        T_keyframe_live: motion since the keyframe that was matched, with covariance.
        keyframe: running number of that keyframe, 0 for the first; a frame with ``is_keyframe`` is the next one, or the
            first. Motions since different keyframes have independent errors but for those of the calibration; motions
            since the same one share the errors of its landmarks, so that covariances add up per keyframe only.
        is_keyframe: whether later frames are matched against this one.
        matches, inliers: landmarks of the keyframe found again, and those that agree on the motion.
        rms: root mean square error of the inliers: pixels in the left image, or metres.
        frame: the preprocessed frame; of a scan, with features corrected for the motion within the turn.
        milliseconds: time spent, by stage: "features", "match", "solve".
        T_previous_keyframe: motion from the keyframe before to that one, as bundle adjustment knows it by now; None
            while it has nothing to say of it.
    """

    stamp_ns: int
    success: bool
    reason: str
    T_odom_live: Array
    T_previous_live: Uncertain
    T_keyframe_live: Uncertain
    keyframe: int
    is_keyframe: bool
    matches: int
    inliers: int
    rms: float
    frame: Frame
    milliseconds: dict[str, float] = field(default_factory=dict)
    T_previous_keyframe: Uncertain | None = None


def first_result(
    stamp_ns: int, frame: Frame, few: str, keyframe: int, T_odom_live: Array, times: dict[str, float]
) -> OdometryResult[Frame]:
    """Of a frame that nothing can be compared with; ``few`` says why it is no keyframe either, and is else empty."""
    return OdometryResult(
        stamp_ns=stamp_ns,
        success=not few,
        reason=few,
        T_odom_live=T_odom_live.copy(),
        T_previous_live=Uncertain.identity(),
        T_keyframe_live=Uncertain.identity(),
        keyframe=keyframe,
        is_keyframe=not few,
        matches=0,
        inliers=0,
        rms=0.0,
        frame=frame,
        milliseconds=times,
    )


def why_not(few: str, matches: int, needed: int) -> str:
    """One sentence for a motion that was not measured; ``few`` is that of a frame that shows too little, or empty."""
    if few:
        return few
    if matches < needed:
        return f"only {matches} landmarks of the keyframe were found again"
    return f"the {matches} matched landmarks do not agree on a motion"
