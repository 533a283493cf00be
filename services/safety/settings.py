"""``[safety]``: the limits of the rules and of the vehicle, and the period of the loop."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated

from pydantic import Field

from services.safety.limits import RuleSettings
from services.safety.monitor import SafetySettings
from services.safety.ramp import RampSettings


@dataclass(frozen=True, slots=True)
class Settings:
    """What lets a command through.

    Attributes:
        rules: ages, distances and uncertainties beyond which the robot is slowed or stopped.
        ramp: speeds and accelerations that no command exceeds.
        estop_button: the joystick's button that latches the emergency stop, counted from 0; None for no button.
        period_s: period of ``command/safe`` in seconds.
    """

    rules: RuleSettings = field(default_factory=RuleSettings)
    ramp: RampSettings = field(default_factory=RampSettings)
    estop_button: Annotated[int, Field(ge=0, lt=32)] | None = None
    period_s: Annotated[float, Field(gt=0, le=0.1)] = 0.02

    def monitor(self) -> SafetySettings:
        """The settings of the monitor."""
        return SafetySettings(self.rules, self.ramp, self.period_s)
