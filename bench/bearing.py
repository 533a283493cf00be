"""Bearing-only teach and repeat in the synthetic world, without processes: how far from the taught path it drives.

The robot is put beside the taught start and drives 72 m with curves both ways. Beside it, in the same world from the
same start: the taught commands alone, replayed by the distance that the wheels count, which is what the images are
there to correct. Run: ``python -m bench bearing``; it takes some minutes.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

import numpy as np

from bench.table import show
from cli.demo.driver import Driver, DriverSettings
from cli.demo.errors import path_errors
from common import geometry
from common.geometry import Array, Uncertain
from common.ids import VertexId, new_map_id
from common.messages import CameraFrame, MapRecord, VertexRecord
from services.estimator.bearing import BearingPipeline, BearingRouteLocalizer, BearingSettings
from services.estimator.bearing.comparison import Comparison
from services.estimator.bearing.submap import BearingSubmap
from services.estimator.chain import ChainSettings
from services.estimator.experience import ExperienceRecorder
from services.estimator.experiences import ExperienceSettings
from services.estimator.route_localizer import WindowSettings
from services.estimator.route_map import RouteMap
from services.estimator.wheels import WheelMotion, WheelSettings
from services.sensors.world import World, WorldSettings
from services.tracker.follower import FollowerSettings
from services.tracker.predict import BaseModel, StatePredictor
from services.tracker.replay import ActionReplay, Motion, ReplaySettings

_TICK = 0.02
_FRAME_TICKS = 5
_CONTROL_TICKS = 2
_LATENCY_TICKS = 4
"""From a frame's stamp until it is localized: 80 ms, as in the demo on a busy machine."""

MAP = new_map_id("r1", 0)


@dataclass(frozen=True, slots=True)
class Start:
    """Where the robot is put: metres left of the taught start, radians to the left, metres along the taught path."""

    lateral: float = 0.0
    heading: float = 0.0
    along: float = 0.0


CASES = (
    (11, Start()),
    (11, Start(0.5, math.radians(5.0))),
    (11, Start(-0.5, math.radians(-5.0), 2.0)),
    (16, Start(0.5, math.radians(5.0))),
)
"""Hour of the repeat, and where it starts."""


@dataclass(frozen=True, slots=True)
class Taught:
    """A taught map: its vertices, their poses by the wheels (N, 4, 4), and the true poses (M, 4, 4) of the teach."""

    vertices: list[VertexRecord]
    path: Array
    truth: Array


class Wheels:
    """What the estimator makes of the wheels between frames."""

    def __init__(self, world: World) -> None:
        self._world = world
        self._motion = WheelMotion(WheelSettings())
        self._first = True

    def step(self) -> Uncertain | None:
        """Motion since the last frame, None at the first."""
        seconds = 0.0 if self._first else _FRAME_TICKS * _TICK
        self._first = False
        return self._motion.step(self._world.wheel_odometry(), seconds)


def teach(world: World, comparison: Comparison, settings: BearingSettings, speed: float) -> Taught:
    """Drives the demo's route by hand."""
    pipeline, wheels = BearingPipeline(settings, comparison), Wheels(world)
    driver = Driver(world.scene.demo_route(), DriverSettings(speed=speed))
    record = MapRecord(id=MAP, environment="garden", stamp=0, robot="r1", sensor="bearing")
    recorder = ExperienceRecorder(record, pipeline)
    vertices: list[VertexRecord] = []
    edges: list[Array] = []
    truth = []
    command: tuple[float, float] | None = (0.0, 0.0)
    tick = 0
    while command is not None or abs(world.twist[0]) > 0.01:
        truth.append(world.T_world_vehicle)
        if command is not None and tick % _CONTROL_TICKS == 0:
            command = driver.command(world.T_world_vehicle, _CONTROL_TICKS * _TICK)
        if tick % _FRAME_TICKS == 0:
            pipeline.obey(*(command or (0.0, 0.0)), 0.0)
            frame = CameraFrame(stamp=round(tick * _TICK * 1e9), image=world.render_left())
            step = pipeline.take(frame, wheels.step())
            commit = recorder.step(step)
            if commit is not None and commit.vertex is not None:
                vertices.append(commit.vertex)
                edges.extend(edge.T_a_b for edge in commit.edges)
        world.step(_TICK, command or (0.0, 0.0))
        tick += 1
    commit = recorder.finish(step)
    if commit.vertex is not None:
        vertices.append(commit.vertex)
        edges.extend(edge.T_a_b for edge in commit.edges)
    path = [np.eye(4)]
    for T in edges:
        path.append(path[-1] @ T)
    return Taught(vertices, np.array(path), np.array(truth))


@dataclass(frozen=True, slots=True)
class Repeat:
    """A repeat: true poses (M, 4, 4), the share of frames localized, errors (F,) of the distance, whether it ended."""

    truth: Array
    localized: float
    distance_error: Array
    finished: bool


def repeat(
    world: World,
    comparison: Comparison,
    settings: BearingSettings,
    taught: Taught,
    start: Start,
    replay: ReplaySettings | None = None,
    *,
    blind: bool = False,
    seed: int = 0,
) -> Repeat:
    """Puts the robot beside the taught start and lets it drive; ``blind`` takes no notice of the images."""
    _put_down(world, taught.truth, start)
    localizer, pipeline = _localizer(taught, comparison, settings, seed)
    wheels, predictor = Wheels(world), StatePredictor(BaseModel())
    follower = FollowerSettings()
    tracker = ActionReplay(follower.limits, follower.caution, replay)
    tracker.set_route(taught.path)
    pending: deque[tuple[int, float, tuple[int, Array, Array, Array]]] = deque()
    latest: tuple[float, tuple[int, Array, Array, Array]] | None = None
    truth, counts, errors = [], [], []
    command, tick, finished = (0.0, 0.0), 0, False
    true_along = _arclengths(taught.truth)
    while tick * _TICK < 200.0 and not finished:
        now = tick * _TICK
        truth.append(world.T_world_vehicle)
        if tick % _FRAME_TICKS == 0:
            frame = CameraFrame(stamp=round(now * 1e9), image=world.render_left())
            step = pipeline.take(frame, wheels.step())
            localizer.move(step)
            localized = False
            if step.success and not (blind and localizer.chain.localized):
                result = localizer.follow(step) if localizer.chain.localized else localizer.search(step)
                localized = result.success
            elif blind and step.success:
                localizer._located(1e9)  # noqa: SLF001, the peer drives on its wheels alone
            counts.append(localized)
            if localizer.chain.localized:
                estimate, actions = localizer.chain.T_trunk_leaf(), localizer.actions()
                assert actions is not None
                state = (localizer.chain.trunk, estimate.T, estimate.covariance, actions)
                pending.append((tick + _LATENCY_TICKS, now, state))
                errors.append(_distance_error(localizer, taught, true_along, world.T_world_vehicle))
        while pending and pending[0][0] <= tick:
            _, at, state = pending.popleft()
            latest = at, state
        if tick % _CONTROL_TICKS == 0 and latest is not None:
            v, w = world.wheel_odometry()
            predictor.odometry(now, v, w)
            command, finished = _command(tracker, predictor, latest, now)
            predictor.command(now, *command)
        world.step(_TICK, command)
        tick += 1
    return Repeat(np.array(truth), float(np.mean(counts)), np.array(errors), finished)


def _command(
    tracker: ActionReplay, predictor: StatePredictor, latest: tuple[float, tuple[int, Array, Array, Array]], now: float
) -> tuple[tuple[float, float], bool]:
    at, (trunk, T, covariance, actions) = latest
    acting, v, w = predictor.predict(np.eye(4), at, now)
    until_now, _, _ = predictor.predict(np.eye(4), at, now - BaseModel().delay)
    motion = Motion(until_now, acting, v, w)
    output = tracker.update(trunk, T, covariance, actions, motion, 0.0, 0.0, _CONTROL_TICKS * _TICK)
    return (output.v, output.w), output.finished


def _localizer(
    taught: Taught, comparison: Comparison, settings: BearingSettings, seed: int
) -> tuple[BearingRouteLocalizer, BearingPipeline]:
    pipeline = BearingPipeline(settings, comparison)
    submaps: dict[VertexId, BearingSubmap] = {vertex.id: pipeline.read(vertex) for vertex in taught.vertices}
    ids = [vertex.id for vertex in taught.vertices]
    route_map = RouteMap(ids, taught.path, pipeline, submaps.get, ExperienceSettings())
    localizer = BearingRouteLocalizer(
        route_map, taught.path, pipeline, ChainSettings(), WindowSettings(), settings, comparison, seed
    )
    localizer.start(None)
    return localizer, pipeline


def _put_down(world: World, truth: Array, start: Start) -> None:
    along = _arclengths(truth)
    first = truth[int(np.searchsorted(along, max(start.along, 0.0), side="right")) - 1]
    yaw = float(geometry.yaw_of(first))
    forward, left = np.array([np.cos(yaw), np.sin(yaw)]), np.array([-np.sin(yaw), np.cos(yaw)])
    x, y = first[:2, 3] + start.lateral * left + min(start.along, 0.0) * forward
    world.place(float(x), float(y), yaw + start.heading)
    for _ in range(10):
        world.step(_TICK, None)


def _arclengths(truth: Array) -> Array:
    return np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(truth[:, :3, 3], axis=0), axis=1))])


def _distance_error(localizer: BearingRouteLocalizer, taught: Taught, true_along: Array, T: Array) -> float:
    """Metres by which the estimated distance is ahead of the robot's true one along the taught path."""
    told = localizer._particles.estimate().metres  # noqa: SLF001, to measure it
    near = np.abs(true_along - told * true_along[-1] / max(localizer._taught.length, 1e-6)) < 4.0  # noqa: SLF001
    nearest = np.flatnonzero(near)[int(np.argmin(np.linalg.norm(taught.truth[near, :2, 3] - T[:2, 3], axis=1)))]
    return float(told - true_along[nearest])


def rms(taught: Taught, repeated: Repeat, after: float = 5.0) -> tuple[float, float]:
    """Root mean square and largest lateral error, metres, from a place of the taught path on."""
    moving = np.linalg.norm(np.diff(repeated.truth[:, :2, 3], axis=0), axis=1) > 1e-4
    lateral = path_errors(taught.truth, repeated.truth[1:][moving]).after(after).lateral
    return float(np.sqrt(np.mean(lateral**2))), float(np.abs(lateral).max())


def main() -> None:
    """Prints the table."""
    settings = BearingSettings()
    comparison, world = Comparison(settings), World(WorldSettings(clouds=0.0))
    taught = teach(world, comparison, settings, speed=1.2)
    rows: list[tuple[object, ...]] = []
    for hour, start in CASES:
        world.set_time(WorldSettings().time.replace(hour=hour))
        for name, blind in (("images and wheels", False), ("wheels alone", True)):
            found = repeat(world, comparison, settings, taught, start, blind=blind)
            error, largest = rms(taught, found)
            place = f"{start.lateral:+.1f} m, {math.degrees(start.heading):+.0f} deg, {start.along:+.0f} m ahead"
            gap = float(np.linalg.norm(found.truth[-1][:2, 3] - taught.truth[-1][:2, 3]))
            along = float(np.sqrt(np.mean(found.distance_error**2)))
            rows.append((f"{hour}:00", place, name, 100 * error, 100 * largest, 100 * along, 100 * gap))
    show(
        f"Bearing-only repeat of a map of {len(taught.vertices)} images taught at 11:00",
        ("repeated", "put down", "driven by", "lateral RMS cm", "largest cm", "distance RMS cm", "end error cm"),
        rows,
        "errors of the truth, lateral ones from 5 m on; distance is the estimated one along the map",
    )
