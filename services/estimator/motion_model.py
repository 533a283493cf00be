"""The motion that is expected of a vehicle from one frame to the next: it moves on as it did."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from common import geometry
from common.geometry import Array, Uncertain

REUSED = 4.0
"""How many times the variance of the last frame's pose counts in the prior of the next: a frame can then never claim
more than a third beside what its own measurements tell, however many were measured against one keyframe."""


@dataclass(frozen=True, slots=True)
class MotionSettings:
    """How a vehicle moves, for the constant-velocity prior.

    Attributes:
        acceleration: standard deviation of the vehicle's acceleration, m/s^2, for the constant-velocity prior.
        angular_acceleration: likewise of its turn, rad/s^2.
        start_speed: standard deviation of the speed before any motion is known, m/s.
        start_turn_rate: likewise of the turn rate, rad/s.
    """

    acceleration: float = 6.0
    angular_acceleration: float = 5.0
    start_speed: float = 12.0
    start_turn_rate: float = 0.6


def moved(covariance: Array, T: Array) -> Array:
    """A left perturbation's covariance (6, 6) seen from the frame that ``T`` takes it to."""
    Ad = geometry.adjoint(T)
    return np.asarray(Ad @ covariance @ Ad.T)


def velocity(T_previous_live: Uncertain, seconds: float) -> Uncertain:
    """Twist per second with covariance, as a transform."""
    twist = geometry.log(T_previous_live.T) / seconds
    return Uncertain(geometry.exp(twist), T_previous_live.covariance / seconds**2)


def constant_velocity(known: Uncertain | None, seconds: float, settings: MotionSettings) -> Uncertain:
    """``T_previous_live`` of a sensor that moves on as it did, or, before any motion, stands with a wide covariance.

    ``known`` is the last :func:`velocity`.
    """
    if known is None:
        return Uncertain(np.eye(4), start_covariance(seconds, settings))
    change = np.repeat([settings.acceleration, settings.angular_acceleration], 3) * seconds**2
    covariance = known.covariance * seconds**2 + np.diag(change**2)
    return Uncertain(geometry.exp(geometry.log(known.T) * seconds), covariance)


def start_covariance(seconds: float, settings: MotionSettings) -> Array:
    """Covariance (6, 6) of a motion of which only the vehicle's speed and turn rate are bounded."""
    return np.diag((np.repeat([settings.start_speed, settings.start_turn_rate], 3) * seconds) ** 2)
