"""Odometry and localization over whole recordings, in one process and without a bus."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from time import perf_counter
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from common import geometry
from common.camera import StereoCamera
from services.estimator.chain import LocalizationChain
from services.estimator.stereo import (
    FeatureSet,
    LocalizationResult,
    OdometryResult,
    StereoLocalizer,
    StereoOdometry,
    StereoSettings,
    in_camera_frames,
    in_vehicle_frames,
    local_map,
    should_create,
    warm_up,
)

Array = NDArray[np.float64]
OnFrame = Callable[[], None]


class Pair(Protocol):
    """A rectified stereo pair: images (H, W) grey or (H, W, 3) RGB, uint8, and its stamp in nanoseconds."""

    @property
    def stamp_ns(self) -> int: ...  # noqa: D102 - said above
    @property
    def left(self) -> NDArray[np.uint8]: ...  # noqa: D102
    @property
    def right(self) -> NDArray[np.uint8]: ...  # noqa: D102


class Recording(Protocol):
    """A drive: its camera, its pairs in order, and the true poses ``T_world_left`` (N, 4, 4) where they are known."""

    @property
    def camera(self) -> StereoCamera: ...  # noqa: D102 - said above
    @property
    def poses_truth(self) -> Array | None: ...  # noqa: D102
    def __iter__(self) -> Iterator[Any]:
        """The pairs, each a :class:`Pair`."""
        ...


@dataclass(frozen=True, slots=True)
class OdometryRun:
    """Odometry over a recording of N pairs.

    Attributes:
        poses: (N, 4, 4) ``T_first_left``: the left camera in the frame of the first pair.
        success: (N,) bool, whether each motion was measured.
        reasons: N sentences, empty where it was.
        inliers: (N,) landmarks that agreed.
        milliseconds: (N,) spent on each pair, without reading it.
        reading_milliseconds: (N,) spent on reading and decoding each pair.
        stages: milliseconds (N,) by stage.
    """

    poses: Array
    success: NDArray[np.bool_]
    reasons: tuple[str, ...]
    inliers: NDArray[np.int64]
    milliseconds: Array
    reading_milliseconds: Array
    stages: dict[str, Array]


@dataclass(frozen=True, slots=True)
class Drift:
    """How far a path ends from the truth when both begin alike.

    Attributes:
        end_point: distance between the two ends, as a part of the true path's length.
        length: of the true path, metres.
        frame_error: median distance between estimated and true motion from pair to pair, metres.
    """

    end_point: float
    length: float
    frame_error: float


def measure_drift(poses: Array, truth: Array) -> Drift:
    """Compare poses (N, 4, 4) with the truth (N, 4, 4), aligned at the first; N is at least 2."""
    estimated, true = geometry.inverse(poses[0]) @ poses, geometry.inverse(truth[0]) @ truth
    length = float(np.linalg.norm(np.diff(true[:, :3, 3], axis=0), axis=1).sum())
    end = float(np.linalg.norm(estimated[-1, :3, 3] - true[-1, :3, 3]))
    motions = (geometry.inverse(poses[:-1]) @ poses[1:] for poses in (true, estimated))
    error = geometry.inverse(next(motions)) @ next(motions)
    return Drift(
        end / length if length > 0.0 else np.inf, length, float(np.median(np.linalg.norm(error[:, :3, 3], axis=1)))
    )


def run_odometry(
    recording: Recording, settings: StereoSettings | None = None, on_frame: OnFrame | None = None
) -> OdometryRun:
    """Odometry over a recording; ``on_frame`` is called after every pair, to show progress.

    What the recording raises when a pair cannot be read is passed on.
    """
    warm_up(recording.camera, settings)
    results: list[tuple[Array, bool, str, int, dict[str, float]]] = []
    spent: list[tuple[float, float]] = []
    for result, reading, processing in _odometry(recording, settings):
        # The frame itself is let go: a long recording's images do not fit in memory.
        results.append((result.T_odom_live, result.success, result.reason, result.inliers, result.milliseconds))
        spent.append((reading, processing))
        if on_frame is not None:
            on_frame()
    poses, success, reasons, inliers, stages = zip(*results, strict=True) if results else ((),) * 5
    times = np.array(spent, dtype=np.float64).reshape(-1, 2)
    return OdometryRun(
        poses=np.array(poses).reshape(-1, 4, 4),
        success=np.array(success, dtype=np.bool_),
        reasons=tuple(reasons),
        inliers=np.array(inliers, dtype=np.int64),
        milliseconds=times[:, 1],
        reading_milliseconds=times[:, 0],
        stages={name: np.array([s[name] for s in stages]) for name in (stages[0] if stages else {})},
    )


def _odometry(recording: Recording, settings: StereoSettings | None) -> Iterator[tuple[OdometryResult, float, float]]:
    """Results with the milliseconds of reading and of processing each pair."""
    odometry = StereoOdometry(recording.camera, settings)
    begin = perf_counter()
    for pair in recording:
        read = perf_counter()
        result = odometry.process(pair.left, pair.right, pair.stamp_ns)
        end = perf_counter()
        yield result, 1e3 * (read - begin), 1e3 * (end - read)
        begin = perf_counter()


@dataclass(frozen=True, slots=True)
class Teach:
    """A taught route.

    Attributes:
        vertices: local map of each vertex, in its optical frame.
        path: (V, 4, 4) ``T_first_vertex`` between vehicle frames.
        frames: (V,) index in the recording of each vertex's pair.
    """

    vertices: tuple[FeatureSet, ...]
    path: Array
    frames: NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class LocalizationRun:
    """A recording of N pairs localized on a taught route.

    Attributes:
        success: (N,) bool.
        reasons: N sentences, empty where localized.
        trunk: (N,) index of the vertex localized against.
        T_vertex_live: (N, 4, 4) vehicle in the trunk's vehicle frame; dead reckoning where not localized.
        poses: (N, 4, 4) ``T_first_live``: left camera in the frame of the first taught pair's left camera.
        inliers: (N,) landmarks that agreed.
        dropouts: metres driven on dead reckoning, one for each stretch without a localization.
        position_errors, rotation_errors: (N,) metres and radians against the truth, or None where it is unknown.
        milliseconds: (N,) odometry and localization together, without reading.
    """

    success: NDArray[np.bool_]
    reasons: tuple[str, ...]
    trunk: NDArray[np.int64]
    T_vertex_live: Array
    poses: Array
    inliers: NDArray[np.int64]
    dropouts: tuple[float, ...]
    position_errors: Array | None
    rotation_errors: Array | None
    milliseconds: Array

    @property
    def coverage(self) -> float:
        """Part of the pairs that were localized."""
        return float(self.success.mean()) if len(self.success) else 0.0


def teach_route(recording: Recording, settings: StereoSettings | None = None, on_frame: OnFrame | None = None) -> Teach:
    """Drive a recording as a teach: odometry, and a vertex wherever one is due."""
    s = settings or StereoSettings()
    warm_up(recording.camera, s)
    mounting = recording.camera.T_vehicle_camera
    vertices: list[FeatureSet] = []
    path: list[Array] = []
    frames: list[int] = []
    for index, (result, _, _) in enumerate(_odometry(recording, s)):
        pose = mounting @ result.T_odom_live @ geometry.inverse(mounting)
        seen = len(result.frame.features) >= s.localization.min_inliers
        inliers = result.inliers if path else s.vertex_creation.min_inliers
        due = not path or should_create(geometry.inverse(path[-1]) @ pose, inliers, s.vertex_creation)
        if seen and due:
            vertices.append(local_map(result.frame.features, s.mapping))
            path.append(pose)
            frames.append(index)
        if on_frame is not None:
            on_frame()
    return Teach(tuple(vertices), np.array(path).reshape(-1, 4, 4), np.array(frames, dtype=np.int64))


@dataclass(frozen=True, slots=True)
class _Located:
    success: bool
    reason: str
    trunk: int
    T_vertex_live: Array
    inliers: int
    metres: float
    milliseconds: float


class _Repeat:
    """A live run along a taught route."""

    def __init__(self, teach: Teach, camera: StereoCamera, settings: StereoSettings) -> None:
        self._teach = teach
        self._mounting = camera.T_vehicle_camera
        self._localizer = StereoLocalizer(camera, settings)
        self._chain = LocalizationChain(teach.path)
        self._last: Array | None = None

    def step(self, result: OdometryResult, milliseconds: float) -> _Located:
        """Localize one pair: by the chain, or by search before the first success."""
        begin = perf_counter()
        metres = 0.0
        if self._last is not None:
            moved = in_vehicle_frames(result.T_previous_live, self._mounting)
            metres = float(np.linalg.norm(moved.T[:3, 3]))
            self._chain.move(moved)
        self._last = result.T_odom_live
        found = self._by_prior(result) if self._chain.localized else self._by_search(result)
        trunk = self._chain.trunk
        if found.success:
            self._chain.localize(found.T_map_live_vehicle)
        T_vertex_live = found.T_map_live_vehicle.T if found.success else self._chain.T_trunk_leaf().T
        milliseconds += 1e3 * (perf_counter() - begin)
        return _Located(found.success, found.reason, trunk, T_vertex_live, found.inliers, metres, milliseconds)

    def _by_prior(self, result: OdometryResult) -> LocalizationResult:
        prior = in_camera_frames(self._chain.T_trunk_leaf(), self._mounting)
        return self._localizer.localize(self._teach.vertices[self._chain.trunk], result.frame, prior)

    def _by_search(self, result: OdometryResult) -> LocalizationResult:
        """Try the vertices from the start of the route on, and take the best of the first that succeed in a row."""
        best, best_index = None, 0
        for index, vertex in enumerate(self._teach.vertices):
            tried = self._localizer.localize_without_prior(vertex, result.frame)
            if best is None or (tried.success, tried.inliers) > (best.success, best.inliers):
                best, best_index = tried, index
            elif best.success and not tried.success:
                break
        assert best is not None  # noqa: S101 - a route has a vertex
        if best.success:
            self._chain.start(best_index)
        return best


def run_localization(
    teach: Recording,
    repeat: Recording,
    settings: StereoSettings | None = None,
    on_frame: OnFrame | None = None,
) -> LocalizationRun:
    """Teach one recording and localize another against it, along the chain.

    Errors against the truth are given where both recordings have it, in one world frame. ``on_frame`` is called after
    every pair of either.

    Raises:
        ValueError: the taught recording shows nothing that could be localized against.
    """
    s = settings or StereoSettings()
    route = teach_route(teach, s, on_frame)
    if not route.vertices:
        raise ValueError(
            "the taught recording has no pair with enough features: teach with textured, well exposed images"
        )
    run = _Repeat(route, repeat.camera, s)
    located: list[_Located] = []
    for result, _, milliseconds in _odometry(repeat, s):
        located.append(run.step(result, milliseconds))
        if on_frame is not None:
            on_frame()
    return _report(located, route, teach, repeat)


def _report(located: list[_Located], route: Teach, teach: Recording, repeat: Recording) -> LocalizationRun:
    trunk = np.array([f.trunk for f in located], dtype=np.int64)
    T_vertex_live = np.array([f.T_vertex_live for f in located]).reshape(-1, 4, 4)
    T_vehicle_camera, T_camera_vehicle = repeat.camera.T_vehicle_camera, geometry.inverse(teach.camera.T_vehicle_camera)
    T_first_live = T_camera_vehicle @ route.path[trunk] @ T_vertex_live @ T_vehicle_camera
    position = rotation = None
    if teach.poses_truth is not None and repeat.poses_truth is not None:
        T_map_live = T_camera_vehicle @ T_vertex_live @ T_vehicle_camera
        truth = geometry.inverse(teach.poses_truth[route.frames[trunk]]) @ repeat.poses_truth[: len(located)]
        error = geometry.inverse(truth) @ T_map_live
        position, rotation = np.linalg.norm(error[:, :3, 3], axis=1), geometry.rotation_angle(error)
    return LocalizationRun(
        success=np.array([f.success for f in located], dtype=np.bool_),
        reasons=tuple(f.reason for f in located),
        trunk=trunk,
        T_vertex_live=T_vertex_live,
        poses=T_first_live,
        inliers=np.array([f.inliers for f in located], dtype=np.int64),
        dropouts=_dropouts(located),
        position_errors=position,
        rotation_errors=rotation,
        milliseconds=np.array([f.milliseconds for f in located]),
    )


def _dropouts(located: list[_Located]) -> tuple[float, ...]:
    """Metres driven from each loss of localization to the next success, or to the end."""
    lengths: list[float] = []
    driven: float | None = None
    for frame in located:
        if driven is not None:
            driven += frame.metres
        if not frame.success and driven is None:
            driven = frame.metres
        elif frame.success and driven is not None:
            lengths.append(driven)
            driven = None
    return tuple(lengths if driven is None else [*lengths, driven])
