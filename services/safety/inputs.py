"""What safety knows in one cycle."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from common.messages import Zone

Array = NDArray[np.float64]


class CommandKind(StrEnum):
    """Where a velocity command comes from."""

    DESIRED = "desired"
    """The tracker, while a route is repeated."""
    TELEOP = "teleop"
    """The operator."""


MOTION_OF_STATE: dict[str, CommandKind] = {
    "teach.metric_localize": CommandKind.TELEOP,
    "teach.branch": CommandKind.TELEOP,
    "teach.merge": CommandKind.TELEOP,
    "repeat.follow": CommandKind.DESIRED,
}
"""The kind of command that each state lets through; a state that is not here lets none through."""


@dataclass(frozen=True, slots=True)
class VelocityCommand:
    """A command as it arrived: m/s forwards, rad/s to the left, where from, and how old."""

    v: float
    w: float
    kind: CommandKind
    age: float


@dataclass(frozen=True, slots=True)
class SafetyInputs:
    """Everything that safety knows in one cycle.

    ``state`` is dotted, as in ``repeat.follow``. ``localization_age`` is that of the last word from the estimator;
    ``metres_since_success`` and ``seconds_since_success`` are what that word said, the latter brought up to now.
    ``covariance`` (6, 6) is that of ``T_trunk_robot``, translation first; where the localization is not ``metric``,
    only the distance along the route (x) and the heading are measured, and only they are judged. ``estop`` is why the
    emergency stop is latched, None where it is not. ``missing`` names the needed services that are not present.
    ``obstacles`` is what lies in the way that the command leads, None where no process watches for obstacles, and
    ``obstacles_age`` how old that word is. ``rearming`` is set by the monitor after an emergency stop, until a moment
    without a command to move has passed.
    """

    state: str | None = None
    state_age: float | None = None
    command: VelocityCommand | None = None
    odometry_age: float | None = None
    localization_age: float | None = None
    switch_held: bool = False
    switch_age: float | None = None
    metres_since_success: float | None = None
    seconds_since_success: float | None = None
    obstacles: Zone | None = None
    obstacles_age: float | None = None
    path_offset: float | None = None
    covariance: Array | None = None
    metric: bool = True
    estop: str | None = None
    missing: tuple[str, ...] = field(default=())
    rearming: bool = False

    @property
    def motion(self) -> CommandKind | None:
        """The kind of command that the state lets through."""
        return MOTION_OF_STATE.get(self.state) if self.state is not None else None
