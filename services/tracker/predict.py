"""Where the robot will be when a command takes effect.

A localisation is as old as its frame, and a command acts only after the delay and the lag of the base. A controller
that ignores this steers for where the robot was: at 1 m/s and 0.3 s it reacts a third of a metre late.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from common.geometry import from_xy_yaw

if TYPE_CHECKING:
    from collections.abc import Sequence

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Twist:
    """From ``stamp`` (s, any one clock) on, the robot moves at ``v`` (m/s, forwards) and ``w`` (rad/s, to the left)."""

    stamp: float
    v: float
    w: float


@dataclass(frozen=True, slots=True)
class BaseModel:
    """How the base follows a command: after a delay, as a first-order lag.

    Attributes:
        delay: seconds until a command acts.
        lag: time constant, seconds.
        history: seconds of twists and commands that are kept.
    """

    delay: float = 0.05
    lag: float = 0.15
    history: float = 2.0


def arc(v: float, w: float, seconds: float) -> Array:
    """``T_robot_later`` (4, 4) of a robot that moves in its own plane at constant speed and turn rate."""
    return from_xy_yaw(*_along_arc(0.0, 0.0, 0.0, v * seconds, w * seconds))


def _along_arc(x: float, y: float, heading: float, metres: float, radians: float) -> tuple[float, float, float]:
    """The pose in the plane after an arc of a length and a turn."""
    half = 0.5 * radians
    # The chord of an arc: its length times sinc of half the angle, in the direction of half the angle.
    chord = metres * (math.sin(half) / half if abs(half) > 1e-6 else 1.0)
    return x + chord * math.cos(heading + half), y + chord * math.sin(heading + half), heading + radians


def move(T_a_robot: ArrayLike, twists: Sequence[Twist], start: float, end: float) -> Array:
    """``T_a_robot`` (4, 4) of the time ``start``, moved in the robot's plane to the time ``end`` by twists in order.

    Each twist holds until the next, the first one also before its stamp. Without a twist, or with ``end`` before
    ``start``, the pose is returned as it is.
    """
    pose = (0.0, 0.0, 0.0)
    for i, twist in enumerate(twists):
        begin = start if i == 0 else max(twist.stamp, start)
        until = end if i == len(twists) - 1 else min(twists[i + 1].stamp, end)
        if until > begin:
            pose = _along_arc(*pose, twist.v * (until - begin), twist.w * (until - begin))
    return np.asarray(T_a_robot, dtype=np.float64) @ from_xy_yaw(*pose)


def respond(
    measured: Twist, commands: Sequence[Twist], end: float, model: BaseModel, step: float = 0.02
) -> list[Twist]:
    """How the base will move from the measured twist until ``end``: twists every ``step`` seconds.

    ``commands`` are those sent, in order, stamped when they were sent; before the first one takes effect the measured
    twist holds.
    """
    twists = []
    stamp, v, w = measured.stamp, measured.v, measured.w
    while stamp < end:
        # The last of a short remainder is cut off, so that the state returned is that of `end` itself.
        seconds = min(step, end - stamp)
        v_goal, w_goal = _in_effect(commands, stamp + 0.5 * seconds - model.delay, measured)
        share = 1.0 - math.exp(-seconds / model.lag) if model.lag > 0.0 else 1.0
        v_next, w_next = v + share * (v_goal - v), w + share * (w_goal - w)
        twists.append(Twist(stamp, 0.5 * (v + v_next), 0.5 * (w + w_next)))
        stamp, v, w = stamp + seconds, v_next, w_next
    twists.append(Twist(stamp, v, w))
    return twists


def _in_effect(commands: Sequence[Twist], sent_before: float, otherwise: Twist) -> tuple[float, float]:
    """The latest command sent before a time."""
    for command in reversed(commands):
        if command.stamp <= sent_before:
            return command.v, command.w
    return otherwise.v, otherwise.w


class StatePredictor:
    """Keeps the last seconds of odometry and commands, and predicts the state at which the next command will act."""

    def __init__(self, model: BaseModel | None = None) -> None:
        self._model = model or BaseModel()
        self._odometry: deque[Twist] = deque()
        self._commands: deque[Twist] = deque()

    def odometry(self, stamp: float, v: float, w: float) -> None:
        """Take a measured twist; one not newer than the last, or not finite, is ignored."""
        self._keep(self._odometry, Twist(stamp, v, w))

    def command(self, stamp: float, v: float, w: float) -> None:
        """Take a command that was sent to the base at ``stamp``."""
        self._keep(self._commands, Twist(stamp, v, w))

    def predict(self, T_a_robot: ArrayLike, stamp: float, now: float) -> tuple[Array, float, float]:
        """The pose (4, 4), speed and turn rate at ``now`` plus the base's delay, from the pose at a frame's ``stamp``.

        Odometry carries the pose up to its last sample, the commands that were sent carry it on from there. Without
        odometry in the kept ``history`` nothing is known of the motion: the pose stays, at rest.
        """
        end = now + self._model.delay
        if not self._odometry or self._odometry[-1].stamp < now - self._model.history:
            return np.array(T_a_robot, dtype=np.float64), 0.0, 0.0
        last = self._odometry[-1]
        future = respond(last, list(self._commands), end, self._model)
        known = [twist for twist in self._odometry if twist.stamp < last.stamp]
        T = move(T_a_robot, [*known, *future], stamp, end)
        return T, future[-1].v, future[-1].w

    def _keep(self, queue: deque[Twist], twist: Twist) -> None:
        if not all(map(math.isfinite, (twist.stamp, twist.v, twist.w))) or (queue and twist.stamp <= queue[-1].stamp):
            return
        queue.append(twist)
        while queue[0].stamp < twist.stamp - self._model.history:
            queue.popleft()
