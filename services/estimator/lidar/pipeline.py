"""The lidar pipeline in vehicle frames, as the estimator's service drives it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from common import geometry
from common.geometry import Array, Uncertain
from common.lidar import LidarScan
from common.messages import Keyframe, VertexRecord
from services.estimator.lidar import mapping
from services.estimator.lidar.appearance import appearance_of
from services.estimator.lidar.features import FeatureError, Landmarks
from services.estimator.lidar.localization import LidarLocalizer, LocalizationResult
from services.estimator.lidar.mapping import LidarSubmap
from services.estimator.lidar.odometry import LidarOdometry
from services.estimator.lidar.preprocessing import LidarFrame
from services.estimator.lidar.settings import LidarSettings
from services.estimator.mounting import in_sensor_frames, in_vehicle_frames
from services.estimator.pipeline import Localized, Step, StreamResult
from services.estimator.thumbnail import thumbnail
from services.estimator.vertex_creation import should_create

NAME = "lidar"
"""Of the pipeline, in the keyframes that it makes, and of its only stream."""
_THUMBNAIL_WIDTH = 512
_MOUNTING = "T_vehicle_lidar"


class LidarPipeline:
    """One spinning lidar's way through the five stages; belongs to one thread.

    ``T_vehicle_lidar`` (4, 4) is where the lidar sits on the vehicle.
    """

    def __init__(self, T_vehicle_lidar: Array, settings: LidarSettings | None = None) -> None:
        self._mounting = np.array(T_vehicle_lidar, dtype=np.float64)
        self._settings = settings or LidarSettings()
        self._odometry = LidarOdometry(self._settings)
        self._localizer = LidarLocalizer(self._settings)
        self._last_stamp: int | None = None

    def close(self) -> None:
        """There is nothing to end: the pipeline has no threads."""

    def process(self, scan: LidarScan, prior: Uncertain | None = None) -> Step[LidarFrame]:
        """Preprocessing and odometry of a scan; ``prior`` is the vehicle's motion since the last one, if known.

        Raises:
            ScanError: the scan is not sound, or does not fit those before.
        """
        if prior is not None:
            prior = in_sensor_frames(prior, self._mounting)
        result = self._odometry.process(scan, prior)
        T_last_live = in_vehicle_frames(result.T_previous_live, self._mounting)
        elapsed = 0.0 if self._last_stamp is None else (scan.stamp_ns - self._last_stamp) * 1e-9
        self._last_stamp = scan.stamp_ns
        twist = geometry.log(T_last_live.T) / elapsed if elapsed > 0.0 else np.zeros(6)
        return Step(
            stamp=scan.stamp_ns,
            T_last_live=T_last_live,
            keyframe=result.keyframe,
            T_keyframe_live=in_vehicle_frames(result.T_keyframe_live, self._mounting),
            twist=twist,
            success=result.success,
            inliers=result.inliers,
            reason=result.reason,
            live=result.frame,
            milliseconds=result.milliseconds,
        )

    def keyframe(self, live: LidarFrame) -> Keyframe:
        """The scan's local map, with a thumbnail of its brightness."""
        seen = live.features.landmarks()
        landmarks = mapping.local_map(seen, self._settings.mapping)
        return Keyframe(
            pipeline=NAME,
            arrays={**landmarks.to_arrays(), _MOUNTING: self._mounting},
            thumbnail=thumbnail(live.brightness, _THUMBNAIL_WIDTH),
            appearance=appearance_of(seen),
        )

    def read(self, record: VertexRecord) -> LidarSubmap:
        """The submap of a stored vertex.

        Raises:
            FeatureError: the keyframe is not one of a lidar, or not whole.
        """
        keyframe = record.keyframe
        if keyframe.pipeline != NAME:
            raise FeatureError(f"the keyframe is of pipeline '{keyframe.pipeline}', not of a lidar")
        mounting = keyframe.arrays.get(_MOUNTING)
        if mounting is None or not geometry.is_transform(mounting):
            raise FeatureError("the keyframe does not say where its lidar was mounted")
        return LidarSubmap.of(Landmarks.from_arrays(keyframe.arrays), np.asarray(mounting, dtype=np.float64))

    def join(self, members: Sequence[tuple[LidarSubmap, Uncertain]]) -> LidarSubmap:
        """One submap of several, each with ``T_first_vertex``, in the first one's frame."""
        return mapping.joined(members)

    def is_vertex_due(self, T_vertex_live: Array, inliers: int) -> bool:
        """Whether the live scan is to become a vertex."""
        return should_create(T_vertex_live, inliers, self._settings.vertex_creation)

    def localize(self, submap: LidarSubmap, prior: Uncertain, live: LidarFrame) -> Localized:
        """Localizes with a prior ``T_vertex_live`` of the vehicle."""
        # The two lidars may be mounted differently.
        T_lidar_vehicle = Uncertain.exactly(geometry.inverse(submap.T_vehicle_lidar))
        guess = T_lidar_vehicle @ prior @ Uncertain.exactly(self._mounting)
        return self._outcome(submap, prior, self._localizer.localize(submap.landmarks, live, guess))

    def search(self, submap: LidarSubmap, live: LidarFrame) -> Localized:
        """Localizes a vehicle of which only the neighbourhood is known."""
        result = self._localizer.localize_without_prior(submap.landmarks, live)
        return self._outcome(submap, Uncertain.identity(), result)

    def _outcome(self, submap: LidarSubmap, prior: Uncertain, result: LocalizationResult) -> Localized:
        """The result between vehicle frames."""
        T_vertex_live = prior
        members: tuple[int, ...] = ()
        if result.success:
            T_lidar_vehicle = Uncertain.exactly(geometry.inverse(self._mounting))
            T_vertex_live = Uncertain.exactly(submap.T_vehicle_lidar) @ result.T_map_live @ T_lidar_vehicle
            counts = np.bincount(submap.owners[result.inlier_landmarks], minlength=submap.size)
            members = tuple(int(count) for count in counts)
        return Localized(
            success=result.success,
            T_vertex_live=T_vertex_live,
            inliers=result.inliers,
            stream=NAME,
            reason=result.reason,
            streams={NAME: StreamResult(result.success, result.inliers, result.reason)},
            members=members,
            pixels=result.inlier_pixels,
        )
