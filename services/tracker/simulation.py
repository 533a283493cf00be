"""A closed loop with a base that slips, lags and is localised late and with noise: to tune a tracker by.

The whole of it is arithmetic: a minute of driving takes a second.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from common.geometry import from_xy_yaw, inverse
from services.tracker.predict import BaseModel, StatePredictor, Twist, arc

Array = NDArray[np.float64]

Controller = Callable[[int, Array, float, float, float], tuple[float, float, bool]]
"""From trunk, predicted ``T_trunk_robot`` (4, 4), v, w and dt to a command v, w and whether it has finished."""

_PHYSICS = 0.01


@dataclass(frozen=True, slots=True)
class World:
    """What the loop does to a controller. Seconds, metres, radians; ``slip`` changes the speeds that the wheels make.

    A frame is localised ``latency`` after it was taken, a command acts ``base.delay`` after it was sent. ``model`` is
    what the predictor believes about the base.
    """

    base: BaseModel = field(default_factory=lambda: BaseModel(delay=0.05, lag=0.15))
    model: BaseModel = field(default_factory=lambda: BaseModel(delay=0.05, lag=0.15))
    slip: float = 0.05
    latency: float = 0.10
    noise_position: float = 0.01
    noise_heading: float = math.radians(0.3)
    localization_period: float = 0.1
    control_period: float = 0.05
    longest: float = 300.0
    seed: int = 1


@dataclass(frozen=True, slots=True)
class Run:
    """True poses (N, 3) as x, y, heading, and commands (N, 2), every control period, and whether it finished."""

    pose: Array
    command: Array
    finished: bool


def lay_route(pieces: Sequence[tuple[float, float]], spacing: float) -> Array:
    """The poses (N, 4, 4) of a plane route's vertices, about ``spacing`` metres apart, the first at the origin.

    Each piece is an arc of constant curvature: metres driven, negative backwards, and radians turned on the way. A turn
    on the spot, of 0 metres, has a vertex every 0.2 rad.
    """
    poses = [np.eye(4)]
    for metres, radians in pieces:
        steps = max(math.ceil(abs(metres) / spacing) if metres else math.ceil(abs(radians) / 0.2), 1)
        poses.extend(_repeated(poses[-1], arc(metres / steps, radians / steps, 1.0), steps))
    return np.array(poses)


def _repeated(T: Array, step: Array, count: int) -> list[Array]:
    """``T step``, ``T step step``, and so on."""
    poses = []
    for _ in range(count):
        T = T @ step
        poses.append(T)
    return poses


def true_errors(pose: Array, route: Array) -> tuple[Array, Array]:
    """Metres driven along a densely laid route (M, 4, 4), and the lateral errors (m), of true poses (N, 3); each (N,).

    The place on the route is followed from pose to pose, and never back by more than a little: it jumps neither where
    the route crosses itself, nor at a cusp to the branch that was driven before. The error is positive to the left of
    the robot's taught heading.
    """
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(route[:, :3, 3], axis=0), axis=1))])
    farthest, places, lateral = 0.0, [], []
    for x, y, _ in pose:
        last = int(np.searchsorted(along, farthest + 0.5)) + 1
        first = int(np.searchsorted(along, farthest - 0.1))
        offset = [x, y] - route[first:last, :2, 3]
        at = first + int(np.argmin(np.einsum("ij,ij->i", offset, offset)))
        farthest = max(farthest, along[at])
        left = route[at, :2, 1]
        places.append(along[at])
        lateral.append(float(left @ ([x, y] - route[at, :2, 3])))
    return np.array(places), np.array(lateral)


def drive(controller: Controller, route: Array, start: Array, world: World) -> Run:
    """Let a controller drive a route of poses (M, 4, 4) from the true start (4, 4), in one frame."""
    rng = np.random.default_rng(world.seed)
    predictor = StatePredictor(world.model)
    T, v, w = np.array(start), 0.0, 0.0
    commands: deque[Twist] = deque([Twist(-math.inf, 0.0, 0.0)])
    frames: deque[tuple[float, int, Array]] = deque()
    latest = (0.0, *_localize(T, route, 0, rng, world))
    poses, sent, finished = [], [], False
    every_control, every_frame = round(world.control_period / _PHYSICS), round(world.localization_period / _PHYSICS)
    for tick in range(round(world.longest / _PHYSICS)):
        now = tick * _PHYSICS
        if tick % every_frame == 0:
            frames.append((now, *_localize(T, route, latest[1], rng, world)))
        while frames and frames[0][0] + world.latency <= now:
            latest = frames.popleft()
        if tick % every_control == 0:
            predictor.odometry(now, v, w)
            T_trunk_robot, v_then, w_then = predictor.predict(latest[2], latest[0], now)
            v_command, w_command, finished = controller(latest[1], T_trunk_robot, v_then, w_then, world.control_period)
            predictor.command(now, v_command, w_command)
            commands.append(Twist(now, v_command, w_command))
            poses.append((T[0, 3], T[1, 3], math.atan2(T[1, 0], T[0, 0])))
            sent.append((v_command, w_command))
            if finished:
                break
        v, w = _follow(commands, now, v, w, world.base)
        slip_v, slip_w = 1.0 + world.slip * math.sin(0.7 * now), 1.0 + world.slip * math.cos(0.45 * now)
        T = T @ arc(v * slip_v, w * slip_w, _PHYSICS)
    return Run(np.array(poses), np.array(sent), finished)


def _follow(commands: deque[Twist], now: float, v: float, w: float, base: BaseModel) -> tuple[float, float]:
    """What the wheels do after one step of physics under the command in effect, which is kept first in the queue."""
    while len(commands) > 1 and commands[1].stamp + base.delay <= now:
        commands.popleft()
    share = 1.0 - math.exp(-_PHYSICS / base.lag) if base.lag > 0.0 else 1.0
    return v + share * (commands[0].v - v), w + share * (commands[0].w - w)


def _localize(T: Array, route: Array, trunk: int, rng: np.random.Generator, world: World) -> tuple[int, Array]:
    """The trunk, searched near the last one, and the noisy ``T_trunk_robot``."""
    first, last = max(trunk - 3, 0), min(trunk + 4, len(route))
    # A radian counts as a metre, or the vertices of a turn on the spot could not be told apart.
    apart = (route[first:last] - T)[:, :2][:, :, [0, 3]]
    trunk = first + int(np.argmin(np.einsum("nij,nij->n", apart, apart)))
    x, y = world.noise_position * rng.standard_normal(2)
    return trunk, inverse(route[trunk]) @ T @ from_xy_yaw(x, y, world.noise_heading * rng.standard_normal())
