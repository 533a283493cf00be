"""The limits of safety's rules."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class RuleSettings:
    """Limits of the rules: ages in seconds, distances in metres, angles in radians.

    The speed falls from its full limit at ``*_slow`` to ``slowest`` of it at ``*_stop``, beyond which the robot stops.

    Attributes:
        command_age: an older command does not pass.
        state_age: how old the navigator's state may be.
        odometry_age: how old odometry may be in a repeat, with what its frame waited for the estimator.
        localization_age: how old the last word on the localization may be in a repeat.
        dead_mans_switch: whether the joystick's switch must be held.
        dead_mans_switch_age: how old the switch's last word may be.
        metres_slow: metres driven since the last localization from which on the robot is slower.
        metres_stop: and at which it stops.
        seconds_slow: seconds since the last localization from which on the robot is slower.
        seconds_stop: and at which it stops.
        slowest: least share of the speed.
        obstacles_age: where obstacles are watched for, how old the last word on them may be.
        obstacle_slow: share of the speed that something in the slow zone leaves.
        path_offset: how far beside the path the robot may be.
        position_sigma: largest standard deviation of a metric position.
        distance_sigma: largest one of the distance along a route by bearing alone.
        heading_sigma: largest one of the heading.
    """

    command_age: float = 0.25
    state_age: float = 0.5
    odometry_age: float = 0.5
    localization_age: float = 0.5
    dead_mans_switch: bool = False
    dead_mans_switch_age: float = 0.3
    metres_slow: float = 3.0
    metres_stop: float = 10.0
    seconds_slow: float = 3.0
    seconds_stop: float = 10.0
    slowest: float = 0.3
    obstacles_age: float = 0.5
    obstacle_slow: float = 0.4
    path_offset: float = 0.8
    position_sigma: float = 0.5
    distance_sigma: float = 1.2
    heading_sigma: float = 0.35

    def __post_init__(self) -> None:
        """Refuse shares of a speed that are none."""
        for name in ("slowest", "obstacle_slow"):
            if not 0.0 <= getattr(self, name) <= 1.0:
                raise ValueError(f"`{name}` is {getattr(self, name)}; it is a share of the speed, from 0 to 1.")
