"""What the vehicle may do, and the two kinds of vehicle that the tracker drives."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum


class LimitError(ValueError):
    """A limit that no vehicle can have, such as a negative acceleration."""


class Drive(StrEnum):
    """How the vehicle steers."""

    UNICYCLE = "unicycle"
    """Speed and turn rate are independent: it turns on the spot (differential or skid steering)."""
    ACKERMANN = "ackermann"
    """It turns only while it moves, on a circle no tighter than its steering allows."""


@dataclass(frozen=True, slots=True)
class Limits:
    """Bounds on every command: SI units, all positive. They hold alike forwards, backwards, left and right.

    Attributes:
        drive: how the vehicle steers: on the spot too, or only while it moves.
        speed: m/s.
        turn_rate: rad/s.
        acceleration, deceleration: m/s^2.
        turn_acceleration: rad/s^2.
        lateral_acceleration: slows the vehicle in curves, m/s^2; it shapes the reference speed and is no hard bound.
        curvature: largest turn rate by speed, 1/m: a must for Ackermann steering, no bound for a unicycle without it.
    """

    drive: Drive = Drive.UNICYCLE
    speed: float = 1.2
    turn_rate: float = 1.0
    acceleration: float = 0.5
    deceleration: float = 0.5
    turn_acceleration: float = 1.5
    lateral_acceleration: float = 0.6
    curvature: float | None = None

    def __post_init__(self) -> None:
        """Refuse what no vehicle can have."""
        for name in ("speed", "turn_rate", "acceleration", "deceleration", "turn_acceleration", "lateral_acceleration"):
            if not 0.0 < getattr(self, name) < float("inf"):
                raise LimitError(f"The limit `{name}` is {getattr(self, name)}; it must be positive and finite.")
        if self.curvature is None and self.drive is Drive.ACKERMANN:
            raise LimitError("A vehicle with Ackermann steering needs the limit `curvature`.")
        if self.curvature is not None and not 0.0 < self.curvature < float("inf"):
            raise LimitError(f"The limit `curvature` is {self.curvature}; it must be positive and finite, or absent.")

    @property
    def turns_on_the_spot(self) -> bool:
        """Whether the vehicle can turn without driving."""
        return self.drive is Drive.UNICYCLE and self.curvature is None
