"""The bearing pipeline in vehicle frames: wheels for odometry, images for the heading, commands to be replayed."""

from __future__ import annotations

import time
from collections.abc import Sequence

import numpy as np

from common import geometry
from common.errors import ImageError
from common.geometry import Array, Uncertain
from common.messages import CameraFrame, Keyframe, VertexRecord
from services.estimator.bearing import submap as submaps
from services.estimator.bearing.actions import ActionLog
from services.estimator.bearing.comparison import BearingLive, Comparison, StoredImage
from services.estimator.bearing.settings import BearingSettings
from services.estimator.bearing.submap import BearingSubmap
from services.estimator.pipeline import Localized, Step
from services.estimator.thumbnail import thumbnail

STREAM = "bearing"

NO_WHEELS = "no wheel odometry arrives: bearing-only teach and repeat counts its way by the wheels"

UNMEASURED_M = 1.0
"""Standard deviation of the lateral offset, metres: nothing measures it, and no rule may rely on it."""

_FRAME_S = 0.1
_TILT = 0.05
_UNKNOWN = np.array([1.0, 0.1, 0.1, 0.1, 0.1, 0.5])
"""Standard deviations of a second's motion that nothing measured, metres and radians."""


class BearingPipeline:
    """One camera's way through the five stages, of which odometry is the wheels'; belongs to one thread."""

    def __init__(self, settings: BearingSettings, comparison: Comparison) -> None:
        self._settings = settings
        self._comparison = comparison
        self._log = ActionLog()
        self._obeyed: tuple[float, float, float] | None = None
        self._last_stamp: int | None = None
        self._frames = 0

    def close(self) -> None:
        """Nothing: it has no thread."""

    def obey(self, v: float, w: float, later: float) -> None:
        """Takes the command (m/s, rad/s) that the base obeys ``later`` seconds after the next frame was taken."""
        self._obeyed = v, w, later

    def take(self, frame: CameraFrame, prior: Uncertain | None) -> Step[BearingLive]:
        """Preprocessing and odometry of an image; ``prior`` is the vehicle's motion since the last one.

        Raises:
            ValueError: the image cannot be represented.
        """
        began = time.perf_counter()
        try:
            prepared = self._comparison.prepare(frame.image)
        except ImageError as error:
            raise ValueError(str(error)) from error
        milliseconds = {"preprocessing": (time.perf_counter() - began) * 1e3}
        seconds = 0.0 if self._last_stamp is None else (frame.stamp - self._last_stamp) * 1e-9
        self._last_stamp = frame.stamp
        self._frames += 1
        motion = prior or Uncertain(np.eye(4), np.diag((_UNKNOWN * max(seconds, _FRAME_S)) ** 2))
        metres, turn = float(motion.T[0, 3]), float(geometry.yaw_of(motion.T))
        self._remember(metres, turn, seconds)
        return Step(
            stamp=frame.stamp,
            T_last_live=motion,
            keyframe=self._frames,
            T_keyframe_live=motion,
            twist=geometry.log(motion.T) / seconds if seconds > 0.0 else np.zeros(6),
            success=prior is not None,
            inliers=0,
            reason="" if prior is not None else NO_WHEELS,
            live=BearingLive(frame.image, prepared, metres, turn),
            milliseconds=milliseconds,
        )

    def keyframe(self, live: BearingLive) -> Keyframe:
        """The image's representation, a thumbnail, and the actions since the keyframe before, which begins anew."""
        return Keyframe(
            pipeline=STREAM,
            arrays=submaps.to_arrays(live.prepared.described, self._log.take()),
            thumbnail=thumbnail(live.image),
        )

    def read(self, record: VertexRecord) -> BearingSubmap:
        """The submap of a stored vertex.

        Raises:
            ValueError: the keyframe is none of a bearing map, or was made by another representation.
        """
        if record.keyframe.pipeline != STREAM:
            raise ValueError(f"the keyframe was made by '{record.keyframe.pipeline}', and this robot drives by bearing")
        try:
            described, actions = submaps.from_arrays(record.keyframe.arrays)
        except ImageError as error:
            raise ValueError(str(error)) from error
        if described.name != self._comparison.name:
            raise ValueError(
                f"the map's images are represented by '{described.name}', the robot's by '{self._comparison.name}': "
                "set [estimator.bearing] as it was in the teach"
            )
        return BearingSubmap(((StoredImage(self._comparison.prepare(described), actions), np.eye(4)),))

    def join(self, members: Sequence[tuple[BearingSubmap, Uncertain]]) -> BearingSubmap:
        """One submap of several, each with ``T_first_vertex``."""
        return BearingSubmap(tuple((image, T.T @ place) for part, T in members for image, place in part.members))

    def is_vertex_due(self, T_vertex_live: Array, inliers: int) -> bool:
        """Whether the live frame is to become a vertex: by the way, or by the turn."""
        del inliers
        distance = float(np.linalg.norm(T_vertex_live[:3, 3]))
        turned = abs(float(geometry.yaw_of(T_vertex_live)))
        return distance >= self._settings.distance or turned >= self._settings.rotation

    def localize(self, submap: BearingSubmap, prior: Uncertain, live: BearingLive) -> Localized:
        """The heading at the stored image that is most like the live one; a prior says no more than a search."""
        found = self.search(submap, live)
        return found if found.success else _failed(found.reason, prior)

    def search(self, submap: BearingSubmap, live: BearingLive) -> Localized:
        """The heading at the stored image that is most like the live one; its place is taken for the robot's."""
        try:
            results = [self._comparison.compare(live, image) for image, _ in submap.members]
        except ImageError as error:
            return _failed(str(error), Uncertain.identity())
        best = max(range(len(results)), key=lambda i: results[i].score)
        found = results[best]
        contrast = float((found.score - found.curve.mean()) / max(float(found.curve.std()), 1e-9))
        if contrast < self._settings.least_contrast:
            return _failed("the image is not like the stored one", Uncertain.identity())
        scale = self._comparison.radians_per_pixel(live)
        T = submap.members[best][1] @ geometry.from_xy_yaw(0.0, 0.0, found.shift_px * scale)
        covariance = covariance_of(self._settings.search_sigma, found.sigma_px * scale)
        return Localized(success=True, T_vertex_live=Uncertain(T, covariance), inliers=0, stream=STREAM, reason="")

    def _remember(self, metres: float, turn: float, seconds: float) -> None:
        """Keeps what was commanded at this frame or, where no command is known, what the wheels did."""
        self._log.move(abs(metres), seconds)
        if seconds <= 0.0:
            return
        v, w = metres / seconds, turn / seconds
        commanded_v, commanded_w, later = self._obeyed or (v, w, 0.0)
        self._log.add(commanded_v, commanded_w, abs(v) * later, later)
        self._obeyed = None


def covariance_of(distance: float, heading: float) -> Array:
    """Covariance (6, 6) of a pose in a vertex's frame of which distance (m) and heading (rad) are known so well."""
    return np.diag(np.array([distance, UNMEASURED_M, _TILT, _TILT, _TILT, heading]) ** 2)


def _failed(reason: str, prior: Uncertain) -> Localized:
    return Localized(success=False, T_vertex_live=prior, inliers=0, stream="none", reason=reason)
