"""The stereo pipeline in vehicle frames, as the estimator's service drives it."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from common import geometry
from common.camera import StereoCamera
from common.geometry import Array, Uncertain
from common.messages import CameraModel, Keyframe, StereoFrame, VertexRecord
from services.estimator.pipeline import Localized, Step
from services.estimator.stereo.features import FeatureSet
from services.estimator.stereo.features import StereoFrame as PreprocessedPair
from services.estimator.stereo.localization import (
    LocalizationResult,
    StereoLocalizer,
    in_camera_frames,
    in_vehicle_frames,
)
from services.estimator.stereo.mapping import local_map
from services.estimator.stereo.odometry import StereoOdometry
from services.estimator.stereo.settings import StereoSettings
from services.estimator.stereo.vertex_creation import should_create

PLAIN = "plain"
"""Name of the stream that works on the images as they are."""

_THUMBNAIL_WIDTH = 200
_JPEG_QUALITY = 80


@dataclass(frozen=True, slots=True)
class StereoSubmap:
    """A vertex's landmarks in its optical frame, and where that camera sat on its vehicle."""

    features: FeatureSet
    T_vehicle_camera: Array


class StereoPipeline:
    """One stereo camera's way through the five stages; belongs to one thread."""

    def __init__(self, camera: StereoCamera, settings: StereoSettings) -> None:
        self._camera = camera
        self._settings = settings
        self._odometry = StereoOdometry(camera, settings)
        self._localizer = StereoLocalizer(camera, settings)
        self._last_stamp: int | None = None

    def process(self, frame: StereoFrame, prior: Uncertain | None = None) -> Step[PreprocessedPair]:
        """Preprocessing and odometry of a frame; ``prior`` is the vehicle's motion since the last one, if known."""
        if prior is not None:
            prior = in_camera_frames(prior, self._camera.T_vehicle_camera)
        result = self._odometry.process(frame.left, frame.right, frame.stamp, prior)
        T_last_live = in_vehicle_frames(result.T_previous_live, self._camera.T_vehicle_camera)
        elapsed = 0.0 if self._last_stamp is None else (frame.stamp - self._last_stamp) * 1e-9
        self._last_stamp = frame.stamp
        twist = geometry.log(T_last_live.T) / elapsed if elapsed > 0.0 else np.zeros(6)
        return Step(
            stamp=frame.stamp,
            T_last_live=T_last_live,
            twist=twist,
            success=result.success,
            inliers=result.inliers,
            reason=result.reason,
            live=result.frame,
            milliseconds=result.milliseconds,
        )

    def keyframe(self, live: PreprocessedPair) -> Keyframe:
        """The frame's local map with a thumbnail."""
        features = local_map(live.features, self._settings.mapping)
        return Keyframe(
            pipeline="stereo",
            camera=CameraModel.of(self._camera),
            arrays={f"{PLAIN}/{name}": array for name, array in features.to_arrays().items()},
            thumbnail=_thumbnail(live.left),
        )

    def read(self, record: VertexRecord) -> StereoSubmap:
        """The submap of a stored vertex.

        Raises:
            FeatureError: the keyframe is not one of a stereo camera, or not whole.
        """
        arrays = {name.removeprefix(f"{PLAIN}/"): array for name, array in record.keyframe.arrays.items()}
        camera = record.keyframe.camera
        mounting = self._camera.T_vehicle_camera if camera is None else camera.T_vehicle_camera
        return StereoSubmap(FeatureSet.from_arrays(arrays), mounting)

    def is_vertex_due(self, T_vertex_live: Array, inliers: int) -> bool:
        """Whether the live frame is to become a vertex."""
        return should_create(T_vertex_live, inliers, self._settings.vertex_creation)

    def localize(self, submap: StereoSubmap, prior: Uncertain, live: PreprocessedPair) -> Localized:
        """Localizes with a prior ``T_vertex_live`` of the vehicle."""
        guess = self._between_cameras(submap, prior)
        return self._outcome(submap, prior, self._localizer.localize(submap.features, live, guess))

    def search(self, submap: StereoSubmap, live: PreprocessedPair) -> Localized:
        """Localizes a vehicle of which only the neighbourhood is known."""
        result = self._localizer.localize_without_prior(submap.features, live)
        return self._outcome(submap, Uncertain.identity(), result)

    def _between_cameras(self, submap: StereoSubmap, T_vertex_live: Uncertain) -> Uncertain:
        """``T_map_live`` of the optical frames; the two cameras may be mounted differently."""
        mounting = Uncertain.exactly(geometry.inverse(submap.T_vehicle_camera))
        return mounting @ T_vertex_live @ Uncertain.exactly(self._camera.T_vehicle_camera)

    def _outcome(self, submap: StereoSubmap, prior: Uncertain, result: LocalizationResult) -> Localized:
        T_vertex_live = prior
        if result.success:
            T_vertex_camera = Uncertain.exactly(submap.T_vehicle_camera)
            T_camera_live = Uncertain.exactly(geometry.inverse(self._camera.T_vehicle_camera))
            T_vertex_live = T_vertex_camera @ result.T_map_live @ T_camera_live
        return Localized(result.success, T_vertex_live, result.inliers, PLAIN, result.reason)


def _thumbnail(image: np.ndarray[tuple[int, ...], np.dtype[np.uint8]]) -> bytes:
    """A small JPEG of an image."""
    height = max(1, round(image.shape[0] * _THUMBNAIL_WIDTH / image.shape[1]))
    small = cv2.resize(image, (_THUMBNAIL_WIDTH, height), interpolation=cv2.INTER_AREA)
    ok, data = cv2.imencode(".jpg", small, [cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY])
    return bytes(data) if ok else b""
