"""The stereo pipeline in vehicle frames, as the estimator's service drives it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from threading import Event, Thread
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from common import geometry
from common.camera import StereoCamera
from common.geometry import Array, Uncertain
from common.messages import CameraModel, Keyframe, VertexRecord
from services.estimator.mounting import in_sensor_frames, in_vehicle_frames
from services.estimator.pipeline import Localized, Step, StreamResult
from services.estimator.relocalization.appearance import appearance_of
from services.estimator.stereo import submap as submaps
from services.estimator.stereo.localization import LocalizationResult, StereoLocalizer
from services.estimator.stereo.mapping import local_map
from services.estimator.stereo.odometry import StereoOdometry
from services.estimator.stereo.settings import StereoSettings
from services.estimator.stereo.streams import INVARIANT, PLAIN, InvariantStream, Streams, is_colour
from services.estimator.stereo.submap import StereoSubmap
from services.estimator.stereo.window import WindowAdjuster
from services.estimator.thumbnail import thumbnail
from services.estimator.vertex_creation import should_create

T = TypeVar("T")


class StereoPipeline:
    """One stereo camera's way through the five stages; belongs to one thread.

    Colour images go through two streams. With ``parallel`` the invariant one has a thread of its own beside the
    caller's, and every call returns when both are done, so that it does not matter which is faster; and the bundle
    adjustment has one, for which no frame waits. Otherwise all is done in turn, and the outcome depends on no timing.
    """

    def __init__(self, camera: StereoCamera, settings: StereoSettings, *, parallel: bool = False) -> None:
        """Raises ValueError where the camera's wavelengths are in no order."""
        self._camera = camera
        self._settings = settings
        self._adjuster = WindowAdjuster(camera, settings, synchronous=not parallel) if settings.bundle.enabled else None
        self._odometry = StereoOdometry(camera, settings, self._adjuster)
        self._localizer = StereoLocalizer(camera, settings)
        self._invariant = InvariantStream(camera, settings) if settings.invariance.enabled else None
        self._beside = ThreadPoolExecutor(1, "invariant") if parallel else None
        self._stop = Event()
        self._thread: Thread | None = None
        if parallel and self._adjuster is not None:
            self._thread = Thread(target=self._adjuster.run, args=(self._stop,), name="window", daemon=True)
            self._thread.start()
        self._last_stamp: int | None = None

    def close(self) -> None:
        """Ends the threads of the second stream and of the bundle adjustment."""
        self._stop.set()
        if self._thread is not None:
            self._thread.join()
        if self._beside is not None:
            self._beside.shutdown()

    def streams_of(self, image: NDArray[Any]) -> str:
        """Which streams images like this one go through, and why not both, in words."""
        if self._invariant is None:
            return "the plain one alone, as configured"
        if not is_colour(image):
            return "the plain one alone: the camera is grey, and the invariant stream needs three colours"
        pair = self._invariant.transform.coefficients
        return f"the plain and the invariant one, alpha {pair.alpha:.4f}, beta {pair.beta:.4f}"

    def process(
        self, left: NDArray[Any], right: NDArray[Any], stamp: int, prior: Uncertain | None = None
    ) -> Step[Streams]:
        """Preprocessing and odometry of a pair; ``prior`` is the vehicle's motion since the last one, if known.

        The images are rectified, (H, W) or (H, W, 3) RGB, uint8; ``stamp`` is in nanoseconds.

        Raises:
            ImageError: an image has another type or size than the camera's.
        """
        if prior is not None:
            prior = in_sensor_frames(prior, self._camera.T_vehicle_camera)
        invariant, rectification = self._invariant, self._odometry.rectification
        second = None
        if invariant is not None and is_colour(left):
            second = self._start(lambda: invariant.preprocess(left, right, stamp, rectification))
        result = self._odometry.process(left, right, stamp, prior)
        live = {PLAIN: result.frame}
        if second is not None:
            live[INVARIANT] = second()
        mounting = self._camera.T_vehicle_camera
        T_last_live = in_vehicle_frames(result.T_previous_live, mounting)
        adjusted = result.T_previous_keyframe
        elapsed = 0.0 if self._last_stamp is None else (stamp - self._last_stamp) * 1e-9
        self._last_stamp = stamp
        twist = geometry.log(T_last_live.T) / elapsed if elapsed > 0.0 else np.zeros(6)
        return Step(
            stamp=stamp,
            T_last_live=T_last_live,
            keyframe=result.keyframe,
            T_keyframe_live=in_vehicle_frames(result.T_keyframe_live, mounting),
            twist=twist,
            success=result.success,
            inliers=result.inliers,
            reason=result.reason,
            live=live,
            milliseconds=result.milliseconds,
            T_previous_keyframe=None if adjusted is None else in_vehicle_frames(adjusted, mounting),
        )

    def keyframe(self, live: Streams) -> Keyframe:
        """The frame's local map in every stream, with a thumbnail."""
        maps = {name: local_map(frame.features, self._settings.mapping) for name, frame in live.items()}
        return Keyframe(
            pipeline="stereo",
            camera=CameraModel.of(self._camera),
            arrays=submaps.to_arrays(maps),
            thumbnail=thumbnail(live[PLAIN].left),
            appearance=appearance_of(maps),
        )

    def read(self, record: VertexRecord) -> StereoSubmap:
        """The submap of a stored vertex.

        Raises:
            FeatureError: the keyframe is not one of a stereo camera, or not whole.
        """
        camera = record.keyframe.camera
        mounting = self._camera.T_vehicle_camera if camera is None else camera.T_vehicle_camera
        return StereoSubmap.of(submaps.from_arrays(record.keyframe.arrays), mounting)

    def join(self, members: Sequence[tuple[StereoSubmap, Uncertain]]) -> StereoSubmap:
        """One submap of several, each with ``T_first_vertex``, in the first one's frame."""
        return submaps.joined(members)

    def is_vertex_due(self, T_vertex_live: Array, inliers: int) -> bool:
        """Whether the live frame is to become a vertex."""
        return should_create(T_vertex_live, inliers, self._settings.vertex_creation)

    def localize(self, submap: StereoSubmap, prior: Uncertain, live: Streams) -> Localized:
        """Localizes with a prior ``T_vertex_live`` of the vehicle, in both streams."""
        guess = self._between_cameras(submap, prior)
        return self._switch(submap, prior, live, lambda s: self._localizer.localize(submap.streams[s], live[s], guess))

    def search(self, submap: StereoSubmap, live: Streams) -> Localized:
        """Localizes a vehicle of which only the neighbourhood is known, in both streams."""
        return self._switch(
            submap,
            Uncertain.identity(),
            live,
            lambda s: self._localizer.localize_without_prior(submap.streams[s], live[s]),
        )

    def _switch(
        self, submap: StereoSubmap, prior: Uncertain, live: Streams, localize: Callable[[str], LocalizationResult]
    ) -> Localized:
        """The plain stream's estimate whenever it localizes, else the invariant one's: never a mixture.

        Section III-B of *Shady dealings*: the invariant stream's estimates are noisier and slightly biased.
        """
        second = None
        if INVARIANT in live and INVARIANT in submap.streams:
            second = self._start(lambda: localize(INVARIANT))
        results = {PLAIN: localize(PLAIN)}
        if second is not None:
            results[INVARIANT] = second()
        stream = next((name for name, result in results.items() if result.success), PLAIN)
        chosen = results[stream]
        outcome = Localized(
            success=chosen.success,
            T_vertex_live=prior,
            inliers=chosen.inliers,
            stream=stream,
            reason=chosen.reason,
            streams={name: StreamResult(r.success, r.inliers, r.reason) for name, r in results.items()},
            pixels=chosen.inlier_places,
        )
        if not chosen.success:
            return outcome
        T_vertex_camera = Uncertain.exactly(submap.T_vehicle_camera)
        T_camera_live = Uncertain.exactly(geometry.inverse(self._camera.T_vehicle_camera))
        members = np.bincount(submap.owners[stream][chosen.inlier_landmarks], minlength=submap.size)
        return replace(
            outcome,
            T_vertex_live=T_vertex_camera @ chosen.T_map_live @ T_camera_live,
            members=tuple(int(count) for count in members),
        )

    def _start(self, work: Callable[[], T]) -> Callable[[], T]:
        """Begins ``work`` in the second stream's thread, where there is one; the result is had by a call."""
        return work if self._beside is None else self._beside.submit(work).result

    def _between_cameras(self, submap: StereoSubmap, T_vertex_live: Uncertain) -> Uncertain:
        """``T_map_live`` of the optical frames; the two cameras may be mounted differently."""
        mounting = Uncertain.exactly(geometry.inverse(submap.T_vehicle_camera))
        return mounting @ T_vertex_live @ Uncertain.exactly(self._camera.T_vehicle_camera)
