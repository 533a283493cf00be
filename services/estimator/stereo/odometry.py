"""Second stage, odometry: the live frame's motion against the last keyframe.

One keyframe serves as long as enough of it is seen: errors then add up per keyframe, not per frame.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from time import perf_counter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from common import geometry
from common.camera import StereoCamera
from common.geometry import Uncertain
from services.estimator import motion_model
from services.estimator.odometry_result import OdometryResult, first_result, why_not
from services.estimator.stereo import matching, model, solver
from services.estimator.stereo.features import StereoFrame
from services.estimator.stereo.preprocessing import preprocess
from services.estimator.stereo.rectification import Rectification, triangulate
from services.estimator.stereo.settings import StereoSettings
from services.estimator.stereo.window import Links, WindowAdjuster, WindowKeyframe

Array = NDArray[np.float64]


@dataclass(slots=True)
class _Motion:
    """What odometry remembers of the last pair."""

    stamp_ns: int
    T_keyframe_last: Uncertain
    velocity: Uncertain | None
    """Twist per second as a transform ``exp(xi)``, None until a motion was measured."""


class StereoOdometry:
    """Odometry of one stream of stereo pairs; :meth:`process` takes them in order.

    The pose is that of the left camera. An instance holds one stream's state and belongs to one thread.
    """

    def __init__(
        self, camera: StereoCamera, settings: StereoSettings | None = None, adjuster: WindowAdjuster | None = None
    ) -> None:
        """``adjuster`` refines the keyframes; whoever makes it runs its thread."""
        self.camera = camera
        self.settings = settings or StereoSettings()
        self._intrinsics = model.intrinsics(camera)
        self._adjuster = adjuster
        self._keyframe: StereoFrame | None = None
        self._T_odom_keyframe: Array = np.eye(4)
        self._motion: _Motion | None = None
        self._rectification = Rectification.unknown(self.settings.noise)
        self._first_sigma = np.inf
        self._failures = 0
        self._number = 0
        self._adjusted: Uncertain | None = None

    @property
    def rectification(self) -> Rectification:
        """The latest estimate of what remains of the cameras' misalignment."""
        return self._rectification

    def reset(self) -> None:
        """Forget keyframe, motion and pose: the next pair is the first."""
        self._keyframe, self._motion, self._failures, self._first_sigma = None, None, 0, np.inf
        self._T_odom_keyframe, self._adjusted = np.eye(4), None
        # A gap, so that no adjustment of before is taken for one of what follows.
        self._number += 2

    def process(
        self, left: NDArray[Any], right: NDArray[Any], stamp_ns: int, prior: Uncertain | None = None
    ) -> OdometryResult[StereoFrame]:
        """Motion of the camera up to this pair of images.

        ``prior`` is ``T_previous_live`` between optical frames, from wheel odometry, say; without it the camera is
        expected to move on as it did. What cannot be measured (no texture, no agreement) is a result without success.

        Raises:
            ImageError: an image has another type or size than the camera's.
        """
        begin = perf_counter()
        frame = preprocess(left, right, stamp_ns, self.camera, self.settings, self._rectification)
        return self.process_frame(frame, prior, features_ms=1e3 * (perf_counter() - begin))

    def process_frame(
        self, frame: StereoFrame, prior: Uncertain | None = None, *, features_ms: float = 0.0
    ) -> OdometryResult[StereoFrame]:
        """As :meth:`process`, for a pair that is preprocessed already."""
        times = {"features": features_ms, "match": 0.0, "solve": 0.0}
        if self._keyframe is None or self._motion is None:
            return self._start(frame, times)
        self._take_adjustment()
        keyframe, motion = self._keyframe, self._motion
        seconds = max((frame.stamp_ns - motion.stamp_ns) * 1e-9, 1e-3)
        step = prior or motion_model.constant_velocity(motion.velocity, seconds, self.settings.odometry)
        T_keyframe_live = motion.T_keyframe_last @ step
        solution, found = self._measure(keyframe, frame, motion.T_keyframe_last, step, times)
        if solution is None:
            wide = Uncertain(np.eye(4), motion_model.start_covariance(seconds, self.settings.odometry))
            solution, found = self._measure(keyframe, frame, motion.T_keyframe_last, wide, times)
        return self._conclude(frame, motion, seconds, T_keyframe_live, solution, found, times)

    def _measure(
        self,
        keyframe: StereoFrame,
        frame: StereoFrame,
        T_keyframe_last: Uncertain,
        step: Uncertain,
        times: dict[str, float],
    ) -> tuple[solver.Solution | None, matching.Matches]:
        """Match the keyframe's landmarks and solve; no solution where too few agree."""
        s, landmarks = self.settings.odometry, keyframe.features
        begin = perf_counter()
        prior = (T_keyframe_last @ step).inverse()
        found = matching.match(landmarks, frame, prior, self.camera, s.matching, self.settings.noise)
        middle = perf_counter()
        # The last pair was measured against the same landmarks, whose errors are no new evidence at the next one.
        weak = Uncertain(T_keyframe_last.T, motion_model.REUSED * T_keyframe_last.covariance) @ step
        chosen = landmarks.landmarks[found.landmarks], landmarks.covariances[found.landmarks]
        solution = solver.solve(
            model.as_uvd(*chosen, self._intrinsics),
            (found.uvd, found.noise),
            prior.T,
            self._intrinsics,
            s.matching,
            weak.inverse(),
            self._rectification.covariance,
        )
        times["match"] += 1e3 * (middle - begin)
        times["solve"] += 1e3 * (perf_counter() - middle)
        matches = len(found.landmarks)
        if solution is not None and (
            solution.inliers.sum() < s.min_inliers or solution.inliers.sum() < s.min_inlier_ratio * matches
        ):
            solution = None
        return solution, found

    def _start(self, frame: StereoFrame, times: dict[str, float]) -> OdometryResult[StereoFrame]:
        """The first pair: nothing to compare it with."""
        few = self._few(frame)
        if not few:
            self._keyframe = frame
            self._motion = _Motion(frame.stamp_ns, Uncertain.identity(), None)
            self._hand_over(frame, np.eye(4), _links(None, None, None))
        return first_result(frame.stamp_ns, frame, few, self._number, self._T_odom_keyframe, times)

    def _conclude(
        self,
        frame: StereoFrame,
        motion: _Motion,
        seconds: float,
        predicted: Uncertain,
        solution: solver.Solution | None,
        found: matching.Matches,
        times: dict[str, float],
    ) -> OdometryResult[StereoFrame]:
        """Take over what was measured, or the prior where nothing was."""
        s = self.settings.odometry
        success, matches = solution is not None, len(found.landmarks)
        inliers = int(solution.inliers.sum()) if solution else 0
        T_keyframe_live = solution.T_live_map.inverse() if solution else predicted
        T_previous_live = Uncertain(
            geometry.inverse(motion.T_keyframe_last.T) @ T_keyframe_live.T,
            motion_model.moved(T_keyframe_live.covariance, geometry.inverse(motion.T_keyframe_last.T)),
        )
        self._failures = 0 if success else self._failures + 1
        velocity = motion_model.velocity(T_previous_live, seconds) if success else motion.velocity
        reason = "" if success else why_not(self._few(frame), matches, s.min_inliers)
        T_odom_live = self._T_odom_keyframe @ T_keyframe_live.T
        if success and not np.isfinite(self._first_sigma):
            self._first_sigma = _position_sigma(T_keyframe_live)
        is_keyframe = self._is_keyframe_due(frame, T_keyframe_live, inliers, success=success)
        result = OdometryResult(
            stamp_ns=frame.stamp_ns,
            success=success,
            reason=reason,
            T_odom_live=T_odom_live,
            T_previous_live=T_previous_live,
            T_keyframe_live=T_keyframe_live,
            keyframe=self._number,
            is_keyframe=is_keyframe,
            matches=matches,
            inliers=inliers,
            rms=solution.rms if solution else 0.0,
            frame=frame,
            milliseconds=times,
            T_previous_keyframe=self._adjusted,
        )
        last = T_keyframe_live
        if is_keyframe:
            if solution is not None:
                # Once per keyframe: further pairs against the same one repeat its errors, which must not count again.
                self._rectification = self._rectification.updated(
                    solution.rectification, solution.rectification_covariance, self.settings.noise
                )
            previous = self._keyframe
            self._keyframe, self._T_odom_keyframe = self._corrected(frame), geometry.normalize(T_odom_live)
            self._failures, self._first_sigma, last = 0, np.inf, Uncertain.identity()
            self._number += 1
            self._adjusted = None
            self._hand_over(frame, T_keyframe_live.T, _links(previous, found, solution))
        self._motion = _Motion(frame.stamp_ns, last, velocity if self._failures < s.max_failures else None)
        return result

    def _hand_over(self, frame: StereoFrame, T_previous_keyframe: Array, links: Links) -> None:
        """Drop the new keyframe off for adjustment, with the landmarks that it shares with the one before."""
        if self._adjuster is not None:
            T, known = self._T_odom_keyframe, self._rectification
            self._adjuster.put(WindowKeyframe(self._number, frame, T, T_previous_keyframe, links, known))

    def _take_adjustment(self) -> None:
        """Pick up what is known better of the present keyframe by now."""
        adjustment = None if self._adjuster is None else self._adjuster.take()
        if adjustment is None or adjustment.keyframe != self._number or self._keyframe is None:
            return
        self._T_odom_keyframe = adjustment.T_odom_keyframe
        self._adjusted = adjustment.T_previous_keyframe
        if self.settings.bundle.refine_landmarks:
            self._keyframe = replace(self._keyframe, features=adjustment.features)
            self._rectification = adjustment.rectification

    def _corrected(self, frame: StereoFrame) -> StereoFrame:
        """The pair with its landmarks by the latest estimate of the rectification."""
        return replace(
            frame,
            features=triangulate(
                frame.features,
                self.camera,
                self.settings.noise,
                self._rectification,
                self.settings.preprocessing.min_disparity,
            ),
        )

    def _few(self, frame: StereoFrame) -> str:
        """What is said of a frame that shows too little, else nothing."""
        shown = len(frame.features)
        return "" if shown >= self.settings.odometry.min_inliers else f"the images show only {shown} features"

    def _is_keyframe_due(self, frame: StereoFrame, T_keyframe_live: Uncertain, inliers: int, *, success: bool) -> bool:
        """Whether the live frame replaces the keyframe."""
        s = self.settings.odometry
        if len(frame.features) < s.min_inliers:
            return False
        if not success:
            return self._failures >= s.max_failures
        landmarks = 0 if self._keyframe is None else len(self._keyframe.features)
        return bool(
            inliers < s.keyframe_inliers
            or inliers < s.keyframe_overlap * landmarks
            or np.linalg.norm(T_keyframe_live.T[:3, 3]) > s.keyframe_distance
            or geometry.rotation_angle(T_keyframe_live.T) > s.keyframe_rotation
            or _position_sigma(T_keyframe_live) > s.keyframe_growth * self._first_sigma
        )


def _links(previous: StereoFrame | None, found: matching.Matches | None, solution: solver.Solution | None) -> Links:
    """The landmarks that agree on the motion from the keyframe before; none where there is no such motion."""
    if previous is None or found is None or solution is None:
        none = np.zeros((0, 2))
        return Links(none.astype(np.float32), np.zeros(0, dtype=np.int64), none, np.zeros((0, 2, 2)))
    kept = solution.inliers
    corners = previous.features.measurements[found.landmarks[kept], :2]
    return Links(corners, found.features[kept], found.uvd[kept, :2], found.noise[kept, :2, :2])


def _position_sigma(T: Uncertain) -> float:
    """Largest standard deviation of the position, metres."""
    return float(np.sqrt(np.linalg.eigvalsh(T.covariance[:3, :3])[-1]))
