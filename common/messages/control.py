"""Velocity commands, and what tracker and safety say of them."""

from __future__ import annotations

from enum import StrEnum
from typing import Annotated

from pydantic import Field

from common.messages.base import Message, Name, NotNegative, Stamp, Text


class VelocityCommand(Message):
    """Speed (m/s) and turn rate (rad/s). ``frame_stamp`` is that of the frame which it follows from, 0 for none."""

    stamp: Stamp
    v: float
    w: float
    frame_stamp: Stamp = 0


class TrackerStatus(Message):
    """The tracker's view of the route: errors, arc length and what remains, metres and radians."""

    stamp: Stamp
    route: Text
    lateral_error: float
    heading_error: float
    arclength: float
    remaining: float
    speed_limit: float
    finished: bool
    reason: Text = ""


class Zone(StrEnum):
    """What lies in the robot's way: nothing, something before which it slows down, or something that stops it."""

    CLEAR = "clear"
    SLOW = "slow"
    STOP = "stop"


class Obstacles(Message):
    """What the obstacle watch sees ahead of the vehicle's origin and behind it, and how far (m) the nearest is."""

    stamp: Stamp
    ahead: Zone
    behind: Zone
    nearest: NotNegative | None = None


class StopReason(Message):
    """A rule that holds the robot back: its name, and one sentence with the figure and the limit."""

    rule: Name
    text: Text


class SafetyStatus(Message):
    """Whether commands pass, how much of their speed, and every reason against."""

    stamp: Stamp
    passing: bool
    scale: Annotated[float, Field(ge=0, le=1)]
    latched: bool
    reasons: list[StopReason]
