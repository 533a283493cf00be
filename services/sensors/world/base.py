"""The wheeled base: a unicycle whose motors lag, whose wheels slip, and which stops when nobody commands it."""

from __future__ import annotations

from collections import deque
from dataclasses import asdict, dataclass

import numpy as np

from common.geometry import Array
from services.sensors.world.settings import BaseSettings

_REST = 1e-9
_TICK = 1e-6
"""Seconds: what a sum of many steps may be off by."""


@dataclass(frozen=True, slots=True)
class BaseState:
    """Where the base is and how it moves.

    Attributes:
        x, y, yaw: pose in the plane, metres and radians.
        wheel_v, wheel_w: what the wheels turn, m/s and rad/s.
        slip_v, slip_w: the parts of it that the ground does not get.
    """

    x: float = 0.0
    y: float = 0.0
    yaw: float = 0.0
    wheel_v: float = 0.0
    wheel_w: float = 0.0
    slip_v: float = 0.0
    slip_w: float = 0.0

    @property
    def twist(self) -> tuple[float, float]:
        """True speed and turn rate over ground, m/s and rad/s."""
        return self.wheel_v * (1.0 - self.slip_v), self.wheel_w * (1.0 - self.slip_w)

    def to_dict(self) -> dict[str, float]:
        """The state as plain numbers, for storage."""
        return asdict(self)

    @classmethod
    def from_dict(cls, stored: dict[str, float]) -> BaseState:
        """The state of :meth:`to_dict`.

        Raises:
            ValueError: a field is missing, unknown, or not a finite number.
        """
        try:
            state = cls(**{name: float(value) for name, value in stored.items()})
        except (TypeError, ValueError) as error:
            raise ValueError(f"not the state of a base: {error}") from error
        if len(stored) != len(cls.__dataclass_fields__) or not np.isfinite(list(asdict(state).values())).all():
            raise ValueError("the state of a base has seven finite numbers")
        return state


class Base:
    """A unicycle that is told velocities and drives them as well as motors and ground allow.

    Times are seconds of any one monotonic clock, given by the caller.
    """

    def __init__(self, settings: BaseSettings, seed: int, state: BaseState | None = None) -> None:
        self._settings, self._rng = settings, np.random.default_rng(seed)
        self.state = state or BaseState()
        self._queue: deque[tuple[float, float, float]] = deque()
        self._target = (0.0, 0.0)
        self._heard: float | None = None

    def command(self, v: float, w: float, now: float) -> None:
        """Accept a command, m/s and rad/s; it is clamped to the limits and takes effect after the delay.

        Raises:
            ValueError: a value is not finite; nothing is accepted.
        """
        if not np.isfinite([v, w, now]).all():
            raise ValueError("a velocity command must be finite")
        s = self._settings
        v = float(np.clip(v, -s.speed_limit, s.speed_limit))
        w = float(np.clip(w, -s.turn_limit, s.turn_limit))
        self._queue.append((now + s.delay, v, w))
        self._heard = now

    def timed_out(self, now: float) -> bool:
        """Whether no command was accepted within the time-out."""
        return self._heard is None or now - self._heard > self._settings.timeout + _TICK

    def step(self, dt: float, now: float) -> None:
        """Move on by ``dt`` seconds, up to ``now``."""
        while self._queue and self._queue[0][0] <= now + _TICK:
            _, v, w = self._queue.popleft()
            self._target = (v, w)
        s, state = self._settings, self.state
        if self.timed_out(now):
            # What was still on its way must not start the base again after it has stopped by itself.
            self._queue.clear()
            self._target = (0.0, 0.0)
        if not any(self._target):
            v, w = _braked(state.wheel_v, state.wheel_w, s.braking * dt)
        else:
            follow = 1.0 - np.exp(-dt / s.lag)
            v = _towards(state.wheel_v, self._target[0], follow, s.acceleration * dt)
            w = _towards(state.wheel_w, self._target[1], follow, s.turn_acceleration * dt)
        self.state = self._moved(dt, v, w)

    def _moved(self, dt: float, v: float, w: float) -> BaseState:
        """The state after ``dt`` seconds on wheels that turn v, w."""
        s, old = self._settings, self.state
        keep = np.exp(-dt / s.slip_seconds)
        spread = (s.slip + s.curve_slip * abs(v * w)) * np.sqrt(1.0 - keep * keep)
        slip_v = old.slip_v * keep + spread * self._rng.standard_normal()
        lost = s.turn_slip + s.curve_slip * abs(v * w)
        slip_w = lost + (old.slip_w - lost) * keep + spread * self._rng.standard_normal()
        true_v, true_w = v * (1.0 - slip_v), w * (1.0 - slip_w)
        half = 0.5 * true_w * dt
        # The chord of the arc: np.sinc(x) is sin(pi x) / (pi x).
        chord = true_v * dt * np.sinc(half / np.pi)
        x = old.x + chord * np.cos(old.yaw + half)
        y = old.y + chord * np.sin(old.yaw + half)
        yaw = (old.yaw + 2.0 * half + np.pi) % (2.0 * np.pi) - np.pi
        return BaseState(float(x), float(y), float(yaw), v, w, float(slip_v), float(slip_w))

    def wheel_odometry(self) -> tuple[float, float]:
        """Speed and turn rate as the wheels report them, m/s and rad/s: noisy, and blind to slip."""
        noise = self._rng.standard_normal(2) * self._settings.odometry_noise
        return self.state.wheel_v * (1.0 + float(noise[0])), self.state.wheel_w * (1.0 + float(noise[1]))

    def pose(self) -> Array:
        """``[x, y, yaw]`` (3,)."""
        return np.array([self.state.x, self.state.y, self.state.yaw])


def _towards(value: float, target: float, follow: float, most: float) -> float:
    """First-order approach to the target, by at most ``most``."""
    return float(value + np.clip((target - value) * follow, -most, most))


def _braked(v: float, w: float, most: float) -> tuple[float, float]:
    """Speeds after braking by ``most`` m/s; the wheels of both sides stop together."""
    left = max(0.0, 1.0 - most / max(abs(v), 0.3 * abs(w), _REST))
    return v * left, w * left
