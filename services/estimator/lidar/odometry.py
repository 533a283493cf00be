"""Second stage, odometry: the live scan's motion against the last keyframe.

The keyframe's landmarks are looked for where the motion prior says, in appearance and place; three that agree make a
motion, robust Gauss-Newton on azimuth, elevation and range refines it. Appearance alone reaches the drift that is asked
for, so no points are registered by their shape.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from time import perf_counter

import numpy as np

from common import geometry
from common.geometry import Array, Uncertain
from common.lidar import LidarScan
from services.estimator import motion_model
from services.estimator.lidar import beams, matching, solver
from services.estimator.lidar import scan as scans
from services.estimator.lidar.beams import ScanError, StackGeometry
from services.estimator.lidar.distortion import T_stamp_middle, compensate, uncertainty
from services.estimator.lidar.features import Landmarks, LidarFeatures
from services.estimator.lidar.preprocessing import LidarFrame, preprocess
from services.estimator.lidar.search import search
from services.estimator.lidar.settings import LidarSettings
from services.estimator.odometry_result import OdometryResult, first_result, why_not

_NARROW = np.diag(np.repeat([0.05, 0.01], 3) ** 2)
"""Covariance around a pose that is looked at once more, beside its own: metres and radians."""
_MAX_MISFITS = 10
"""After as many scans in a row that do not fit, the lidar is taken to be another one than was thought."""


@dataclass(frozen=True, slots=True)
class _Keyframe:
    """What scans are matched against.

    Attributes:
        features: as measured, before any correction.
        landmarks: after it.
        correction: (6, 6) covariance that the correction leaves.
    """

    features: LidarFeatures
    landmarks: Landmarks
    correction: Array


@dataclass(frozen=True, slots=True)
class _Motion:
    """What odometry remembers of the last scan."""

    stamp_ns: int
    T_keyframe_last: Uncertain
    velocity: Uncertain | None
    """Twist per second as a transform ``exp(xi)``, None until a motion was measured."""
    T_last_middle: Array
    """(4, 4), the lidar in the middle of the last turn, by the twist that the turn was corrected with."""


@dataclass(frozen=True, slots=True)
class _Measured:
    """One attempt at a motion.

    Attributes:
        features: that it was made of, corrected with ``twist`` (6,).
        matches: how many landmarks were found again.
        solution: the pose, if there is one.
    """

    features: LidarFeatures
    twist: Array
    matches: int
    solution: solver.Solution | None


class LidarOdometry:
    """Odometry of one lidar; :meth:`process` takes its scans in order.

    An instance holds one stream's state and belongs to one thread.
    """

    def __init__(self, settings: LidarSettings | None = None) -> None:
        self.settings = settings or LidarSettings()
        self._geometry: StackGeometry | None = None
        self._misfits = 0
        self._keyframe: _Keyframe | None = None
        self._T_odom_keyframe: Array = np.eye(4)
        self._motion: _Motion | None = None
        self._failures = 0
        self._number = 0

    def process(self, scan: LidarScan, prior: Uncertain | None = None) -> OdometryResult[LidarFrame]:
        """Motion of the lidar up to this scan.

        ``prior`` is ``T_previous_live`` between lidar frames, from wheel odometry, say; without it the lidar is
        expected to move on as it did. What cannot be measured is a result without success.

        Raises:
            ScanError: the scan is not sound, or does not fit those before.
        """
        begin = perf_counter()
        frame = self._preprocess(scan)
        times = {"features": 1e3 * (perf_counter() - begin), "match": 0.0, "solve": 0.0}
        if self._keyframe is None or self._motion is None:
            return self._start(frame, times)
        keyframe, motion = self._keyframe, self._motion
        seconds = max((frame.stamp_ns - motion.stamp_ns) * 1e-9, 1e-3)
        step = prior or motion_model.constant_velocity(motion.velocity, seconds, self.settings.odometry)
        measured = None
        if prior is not None or motion.velocity is not None:
            measured = self._measure(keyframe, frame, motion, step, seconds, times)
        if measured is None or measured.solution is None:
            measured = self._search(keyframe, frame, motion, seconds, times)
        # Measuring may have told how the last scan moved.
        return self._conclude(frame, self._motion, seconds, motion.T_keyframe_last @ step, measured, times)

    def _preprocess(self, scan: LidarScan) -> LidarFrame:
        """The scan's keypoints; the first sound scan tells how the lidar's beams lie."""
        scans.check(scan)
        if self._geometry is None:
            geometry_ = beams.estimate_geometry(scan)
            frame = preprocess(scan, geometry_, self.settings)
            self._geometry = geometry_
            return frame
        try:
            frame = preprocess(scan, self._geometry, self.settings)
        except ScanError:
            self._misfits += 1
            if self._misfits >= _MAX_MISFITS:
                self._geometry, self._misfits = None, 0
            raise
        self._misfits = 0
        return frame

    def _measure(
        self,
        keyframe: _Keyframe,
        frame: LidarFrame,
        motion: _Motion,
        step: Uncertain,
        seconds: float,
        times: dict[str, float],
    ) -> _Measured:
        """Match around ``step``, the expected motion since the last scan, and solve."""
        twist = geometry.log(step.T) / seconds
        first = self._solve(keyframe.landmarks, frame, twist, motion, step, step, times)
        return self._again(first, keyframe, frame, motion, step, seconds, times)

    def _search(
        self, keyframe: _Keyframe, frame: LidarFrame, motion: _Motion, seconds: float, times: dict[str, float]
    ) -> _Measured:
        """Match and solve where only the vehicle's speed is bounded."""
        s = self.settings.odometry
        begin = perf_counter()
        anything = Uncertain(np.eye(4), motion_model.start_covariance(seconds, s))
        live = self._corrected(frame.features, np.zeros(6))
        guess = (motion.T_keyframe_last @ anything).inverse()
        found, solution = search(keyframe.landmarks, live, frame.ranges, guess, s.matching, s.matching)
        times["match"] += 1e3 * (perf_counter() - begin)
        first = self._judged(keyframe.landmarks, frame, live, np.zeros(6), len(found.landmarks), solution)
        return self._again(first, keyframe, frame, motion, anything, seconds, times)

    def _again(
        self,
        first: _Measured,
        keyframe: _Keyframe,
        frame: LidarFrame,
        motion: _Motion,
        step: Uncertain,
        seconds: float,
        times: dict[str, float],
    ) -> _Measured:
        """Once more, with the motion within the turn as the first pose tells it."""
        raw = frame.features
        if first.solution is None or not (raw.offsets.any() and self.settings.odometry.compensate):
            return first
        T_last_keyframe = geometry.inverse(motion.T_keyframe_last.T)
        T_last_live = T_last_keyframe @ geometry.inverse(first.solution.T_live_map.T)
        twist = _twist(motion, T_last_live, T_stamp_middle(raw, first.twist), seconds)
        landmarks = keyframe.landmarks
        if motion.velocity is None:
            # The keyframe is the last scan: only now is anything known of how it moved.
            landmarks = self._corrected(keyframe.features, twist).landmarks()
            self._keyframe = replace(keyframe, landmarks=landmarks)
            motion = replace(motion, T_last_middle=T_stamp_middle(keyframe.features, twist))
            self._motion = motion
        around = Uncertain(T_last_live, first.solution.T_live_map.covariance + _NARROW)
        second = self._solve(landmarks, frame, twist, motion, around, step, times)
        return second if second.solution is not None else first

    def _corrected(self, features: LidarFeatures, twist: Array) -> LidarFeatures:
        return compensate(features, twist if self.settings.odometry.compensate else np.zeros(6))

    def _solve(
        self,
        landmarks: Landmarks,
        frame: LidarFrame,
        twist: Array,
        motion: _Motion,
        around: Uncertain,
        known: Uncertain,
        times: dict[str, float],
    ) -> _Measured:
        """Match and solve; both motions are since the last scan: where to look, and what the prior knows."""
        s, T_keyframe_last = self.settings.odometry.matching, motion.T_keyframe_last
        live = self._corrected(frame.features, twist)
        begin = perf_counter()
        T_live_keyframe = (T_keyframe_last @ around).inverse()
        found = matching.match(landmarks, live, T_live_keyframe, s)
        middle = perf_counter()
        # The last scan was measured against the same landmarks, whose errors are no new evidence at the next one.
        reused = Uncertain(T_keyframe_last.T, motion_model.REUSED * T_keyframe_last.covariance)
        weak = (reused @ known).inverse()
        solution = solver.solve_matches(landmarks, live, found, T_live_keyframe.T, s, weak)
        times["match"] += 1e3 * (middle - begin)
        times["solve"] += 1e3 * (perf_counter() - middle)
        return self._judged(landmarks, frame, live, twist, len(found.landmarks), solution)

    def _judged(
        self,
        landmarks: Landmarks,
        frame: LidarFrame,
        live: LidarFeatures,
        twist: Array,
        matches: int,
        solution: solver.Solution | None,
    ) -> _Measured:
        """What was measured, without its pose where too few agree on it, or the ranges do not."""
        s = self.settings.odometry
        needed = max(float(s.min_inliers), s.min_inlier_ratio * matches)
        if solution is not None and (
            solution.inliers.sum() < needed
            or frame.ranges.agreement(landmarks.points, solution.T_live_map.T) < s.min_agreement
        ):
            solution = None
        return _Measured(live, twist, matches, solution)

    def _start(self, frame: LidarFrame, times: dict[str, float]) -> OdometryResult[LidarFrame]:
        """The first scan: nothing to compare it with."""
        few = self._few(frame)
        if not few:
            still = self._corrected(frame.features, np.zeros(6))
            self._keyframe = _Keyframe(frame.features, still.landmarks(), np.zeros((6, 6)))
            self._motion = _Motion(frame.stamp_ns, Uncertain.identity(), None, np.eye(4))
        return first_result(frame.stamp_ns, frame, few, self._number, self._T_odom_keyframe, times)

    def _conclude(
        self,
        frame: LidarFrame,
        motion: _Motion,
        seconds: float,
        predicted: Uncertain,
        measured: _Measured,
        times: dict[str, float],
    ) -> OdometryResult[LidarFrame]:
        """Take over what was measured, or the prior where nothing was."""
        solution = measured.solution
        success = solution is not None
        inliers = int(solution.inliers.sum()) if solution else 0
        T_keyframe_live = solution.T_live_map.inverse() if solution else predicted
        T_last_keyframe = geometry.inverse(motion.T_keyframe_last.T)
        T_last_live = T_last_keyframe @ T_keyframe_live.T
        self._failures = 0 if success else self._failures + 1
        used = measured.twist if success else geometry.log(T_last_live) / seconds
        corrected = measured.features if success else self._corrected(frame.features, used)
        T_live_middle = T_stamp_middle(frame.features, used)
        velocity, correction = motion.velocity, np.zeros((6, 6))
        if success:
            twist = _twist(motion, T_last_live, T_live_middle, seconds)
            change = np.zeros(6) if velocity is None else twist - geometry.log(velocity.T)
            correction = uncertainty(frame.features, T_keyframe_live.covariance, change, seconds)
            before = Uncertain(np.eye(4), np.zeros((6, 6)) if self._keyframe is None else self._keyframe.correction)
            T_keyframe_live = before @ T_keyframe_live @ Uncertain(np.eye(4), correction)
            moved = motion_model.moved(T_keyframe_live.covariance, T_last_keyframe)
            velocity = Uncertain(geometry.exp(twist), moved / seconds**2)
        T_previous_live = Uncertain(T_last_live, motion_model.moved(T_keyframe_live.covariance, T_last_keyframe))
        T_odom_live = self._T_odom_keyframe @ T_keyframe_live.T
        is_keyframe = self._is_keyframe_due(len(corrected), T_keyframe_live.T, inliers, success=success)
        result = OdometryResult(
            stamp_ns=frame.stamp_ns,
            success=success,
            reason="" if success else why_not(self._few(frame), measured.matches, self.settings.odometry.min_inliers),
            T_odom_live=T_odom_live,
            T_previous_live=T_previous_live,
            T_keyframe_live=T_keyframe_live,
            keyframe=self._number,
            is_keyframe=is_keyframe,
            matches=measured.matches,
            inliers=inliers,
            rms=solution.rms if solution else 0.0,
            frame=replace(frame, features=corrected, correction=correction),
            milliseconds=times,
        )
        last = T_keyframe_live
        if is_keyframe:
            self._keyframe = _Keyframe(frame.features, corrected.landmarks(), correction)
            self._T_odom_keyframe = geometry.normalize(T_odom_live)
            self._number += 1
            last, self._failures = Uncertain.identity(), 0
        known = (
            velocity if self._failures < self.settings.odometry.max_failures and (success or not is_keyframe) else None
        )
        self._motion = _Motion(frame.stamp_ns, last, known, T_live_middle)
        return result

    def _few(self, frame: LidarFrame) -> str:
        """What is said of a frame that shows too little, else nothing."""
        shown = len(frame.features)
        return "" if shown >= self.settings.odometry.min_inliers else f"the scan shows only {shown} keypoints"

    def _is_keyframe_due(self, features: int, T_keyframe_live: Array, inliers: int, *, success: bool) -> bool:
        """Whether the live scan replaces the keyframe."""
        s = self.settings.odometry
        if features < s.min_inliers:
            return False
        if not success:
            # Before any motion is known nothing is lost by beginning anew, and the next scan is nearer to this one.
            return self._failures >= s.max_failures or self._motion is None or self._motion.velocity is None
        return bool(
            inliers < s.keyframe_inliers
            or np.linalg.norm(T_keyframe_live[:3, 3]) > s.keyframe_distance
            or geometry.rotation_angle(T_keyframe_live) > s.keyframe_rotation
        )


def _twist(motion: _Motion, T_last_live: Array, T_live_middle: Array, seconds: float) -> Array:
    """The lidar's twist (6,), m/s and rad/s, from the middle of the last turn to that of the live one."""
    return np.asarray(geometry.log(geometry.inverse(motion.T_last_middle) @ T_last_live @ T_live_middle) / seconds)
