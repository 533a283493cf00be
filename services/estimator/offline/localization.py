"""Teaching and repeating recordings, in one process and without a bus, by the very parts that the service runs."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from time import perf_counter

import numpy as np
from numpy.typing import NDArray

from common import geometry
from common.camera import StereoCamera
from common.ids import VertexId
from services.estimator.coverage import dropouts
from services.estimator.experience import ExperienceRecorder
from services.estimator.experiences import RouteExperiences
from services.estimator.offline.memory import Memory
from services.estimator.offline.recording import OnFrame, Pair, Recording
from services.estimator.pipeline import Localized, Step
from services.estimator.route_localizer import RouteLocalizer
from services.estimator.route_map import RouteMap
from services.estimator.settings import Settings
from services.estimator.stereo.pipeline import StereoPipeline
from services.estimator.stereo.streams import Streams
from services.estimator.stereo.submap import StereoSubmap
from services.estimator.stereo.warm_up import warm_up

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class Processed:
    """A pair after preprocessing and odometry.

    Attributes:
        step: what they made of it.
        T_world_left: (4, 4) its true pose, None where it is unknown.
        milliseconds: spent on it, without reading it.
    """

    step: Step[Streams]
    T_world_left: Array | None
    milliseconds: float


@dataclass(frozen=True, slots=True)
class LocalizationRun:
    """A recording of N pairs localized on a taught route.

    Attributes:
        success: (N,) bool, of the combined system: the plain stream where it localizes, else the invariant one.
        streams: (N,) bool of each stream, by name.
        reasons: N sentences, empty where localized.
        trunk: (N,) index of the vertex localized against.
        T_vertex_live: (N, 4, 4) vehicle in the trunk's vehicle frame; dead reckoning where not localized.
        covariances: (N, 6, 6) of them.
        poses: (N, 4, 4) ``T_first_live``: left camera in the frame of the first taught pair's left camera.
        inliers: (N,) landmarks that agreed.
        distance: (N,) metres driven up to each pair.
        position_errors, rotation_errors: (N,) metres and radians against the truth, or None where it is unknown.
        milliseconds: (N,) odometry and localization together, without reading.
        localizing_milliseconds: (N,) localization alone.
    """

    success: Mask
    streams: dict[str, Mask]
    reasons: tuple[str, ...]
    trunk: NDArray[np.int64]
    T_vertex_live: Array
    covariances: Array
    poses: Array
    inliers: NDArray[np.int64]
    distance: Array
    position_errors: Array | None
    rotation_errors: Array | None
    milliseconds: Array
    localizing_milliseconds: Array

    @property
    def coverage(self) -> float:
        """Part of the pairs that were localized."""
        return float(self.success.mean()) if len(self.success) else 0.0

    @property
    def dropouts(self) -> Array:
        """Metres driven on dead reckoning, one for each stretch without a localization."""
        return dropouts(self.success, self.distance)


def process(recording: Recording, settings: Settings, on_frame: OnFrame | None = None) -> Iterator[Processed]:
    """The pairs of a recording after preprocessing and odometry, one by one."""
    warm_up(recording.camera, settings.stereo)
    pipeline = StereoPipeline(recording.camera, settings.stereo)
    truth = recording.poses_truth
    pair: Pair
    for index, pair in enumerate(recording):
        begin = perf_counter()
        step = pipeline.process(pair.left, pair.right, pair.stamp_ns)
        milliseconds = 1e3 * (perf_counter() - begin)
        yield Processed(step, None if truth is None else truth[index], milliseconds)
        if on_frame is not None:
            on_frame()


class Route:
    """A taught route, and the experiences of its repeats.

    The camera is the one of every drive.
    """

    def __init__(self, camera: StereoCamera, settings: Settings | None = None) -> None:
        self.camera = camera
        self.settings = settings or Settings()
        self.memory = Memory()
        self._pipeline = StereoPipeline(camera, self.settings.stereo)

    def teach(self, drive: Iterable[Processed]) -> None:
        """Makes a drive the taught route.

        Raises:
            ValueError: no pair of it shows enough to localize against.
        """
        self._record(drive, lambda _: None)
        if not self.memory.route:
            raise ValueError(
                "the taught recording has no pair with enough features: teach with textured, well exposed images"
            )

    def repeat(self, drive: Iterable[Processed], *, record: bool = False) -> LocalizationRun:
        """Localizes a drive along the taught route; with ``record`` it becomes an experience for the next repeats."""
        repeat = _Repeat(self.memory, self._pipeline, self.settings)
        if record:
            self._record(drive, repeat.take)
        else:
            for processed in drive:
                repeat.take(processed)
        return repeat.report(self.camera)

    def _record(
        self, drive: Iterable[Processed], localize: Callable[[Processed], tuple[VertexId, geometry.Uncertain] | None]
    ) -> None:
        """Makes a map of a drive, each pair of which is localized first."""
        recorder: ExperienceRecorder[Streams, StereoSubmap] | None = None
        made = []
        last = None
        for processed in drive:
            last = processed
            if recorder is None:
                recorder = ExperienceRecorder(self.memory.record(processed.step.stamp), self._pipeline)
            localized = localize(processed)
            usable = processed.step if self._is_usable(processed.step) else replace(processed.step, success=False)
            commit = recorder.step(usable, localized)
            if commit is not None:
                made.append((commit, processed.T_world_left))
        if recorder is not None and last is not None:
            made.append((recorder.finish(last.step if self._is_usable(last.step) else None), last.T_world_left))
        # Only now: a drive must not be localized against itself.
        for commit, T_world_left in made:
            self.memory.add(commit, self._pipeline, T_world_left)

    def _is_usable(self, step: Step[Streams]) -> bool:
        """Whether a pair shows enough to be localized against."""
        return any(len(frame.features) >= self.settings.stereo.localization.min_inliers for frame in step.live.values())


class _Repeat:
    """One drive along a route."""

    def __init__(self, memory: Memory, pipeline: StereoPipeline, settings: Settings) -> None:
        self._memory = memory
        self._vertices = memory.route
        self._path = memory.graph.poses_along(self._vertices)
        route_map: RouteMap[Streams, StereoSubmap] = RouteMap(
            self._vertices, self._path, pipeline, memory.submaps.get, settings.experiences
        )
        # Nobody tells where on the route the recording begins.
        window = replace(settings.window, search=float("inf"), searches=5)
        self._localizer = RouteLocalizer(route_map, self._path, pipeline, settings.chain, window)
        if len(memory.graph.experiences) > 1:
            self._localizer.use(RouteExperiences(memory.graph, self._vertices, self._path, settings.experiences))
        self._localizer.start(None)
        self._frames: list[_Located] = []

    def take(self, processed: Processed) -> tuple[VertexId, geometry.Uncertain] | None:
        """Localizes a pair; where it is, if that was found."""
        begin = perf_counter()
        localizer, chain = self._localizer, self._localizer.chain
        localizer.move(processed.step)
        trunk = chain.trunk
        result = localizer.follow(processed.step) if chain.localized else localizer.search(processed.step)
        milliseconds = 1e3 * (perf_counter() - begin)
        # What localizes belongs to the vertex that was the trunk then; a search has chosen one.
        trunk = chain.branch if result.success else trunk
        T_vertex_live = result.T_vertex_live if result.success else chain.T_trunk_leaf()
        self._frames.append(_Located(processed, result, trunk, T_vertex_live, milliseconds))
        return (self._vertices[trunk], T_vertex_live) if result.success else None

    def report(self, camera: StereoCamera) -> LocalizationRun:
        """The whole drive."""
        frames = self._frames
        trunk = np.array([f.trunk for f in frames], dtype=np.int64)
        T_vertex_live = np.array([f.T_vertex_live.T for f in frames]).reshape(-1, 4, 4)
        T_vehicle_camera = camera.T_vehicle_camera
        T_map_live = geometry.inverse(T_vehicle_camera) @ T_vertex_live @ T_vehicle_camera
        T_first_vertex = geometry.inverse(T_vehicle_camera) @ self._path[trunk] @ T_vehicle_camera
        position, rotation = self._errors(T_map_live, trunk)
        names = dict.fromkeys(name for f in frames for name in f.result.streams)
        step = np.array([np.linalg.norm(f.processed.step.T_last_live.T[:3, 3]) for f in frames])
        localizing = np.array([f.milliseconds for f in frames])
        return LocalizationRun(
            success=np.array([f.result.success for f in frames], dtype=np.bool_),
            streams={
                name: np.array([name in f.result.streams and f.result.streams[name].success for f in frames])
                for name in names
            },
            reasons=tuple(f.result.reason for f in frames),
            trunk=trunk,
            T_vertex_live=T_vertex_live,
            covariances=np.array([f.T_vertex_live.covariance for f in frames]).reshape(-1, 6, 6),
            poses=T_first_vertex @ T_map_live,
            inliers=np.array([f.result.inliers for f in frames], dtype=np.int64),
            distance=np.cumsum(step),
            position_errors=position,
            rotation_errors=rotation,
            milliseconds=np.array([f.processed.milliseconds for f in frames]) + localizing,
            localizing_milliseconds=localizing,
        )

    def _errors(self, T_map_live: Array, trunk: NDArray[np.int64]) -> tuple[Array | None, Array | None]:
        """Metres and radians (N,) off the truth, None where it is not known of every pair."""
        known = [self._memory.truth.get(vertex) for vertex in self._vertices]
        live = [f.processed.T_world_left for f in self._frames]
        truth = [(known[i], T) for i, T in zip(trunk, live, strict=True)]
        pairs = [(a, b) for a, b in truth if a is not None and b is not None]
        if len(pairs) < len(truth):
            return None, None
        T_world_map, T_world_live = (np.array(side).reshape(-1, 4, 4) for side in zip(*pairs, strict=True))
        error = geometry.inverse(geometry.inverse(T_world_map) @ T_world_live) @ T_map_live
        return np.linalg.norm(error[:, :3, 3], axis=1), geometry.rotation_angle(error)


@dataclass(frozen=True, slots=True)
class _Located:
    processed: Processed
    result: Localized
    trunk: int
    T_vertex_live: geometry.Uncertain
    milliseconds: float


def run_localization(
    teach: Recording, repeat: Recording, settings: Settings | None = None, on_frame: OnFrame | None = None
) -> LocalizationRun:
    """Teach one recording and localize another against it, along the chain.

    Errors against the truth are given where both recordings have it, in one world frame. ``on_frame`` is called after
    every pair of either.

    Raises:
        ValueError: the taught recording shows nothing that could be localized against.
    """
    route = Route(repeat.camera, settings)
    route.teach(process(teach, route.settings, on_frame))
    return route.repeat(process(repeat, route.settings, on_frame))
