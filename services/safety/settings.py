"""``[safety]``: the limits of the rules and of the vehicle, and the period of the loop."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated

from pydantic import Field

from services.safety.monitor import SafetySettings
from services.safety.ramp import RampSettings
from services.safety.rules import RuleSettings


@dataclass(frozen=True, slots=True)
class Settings:
    """What lets a command through.

    Attributes:
        rules: ages, distances and uncertainties beyond which the robot is slowed or stopped.
        ramp: speeds and accelerations that no command exceeds.
        period_s: period of ``command/safe`` in seconds.
    """

    rules: RuleSettings = field(default_factory=RuleSettings)
    ramp: RampSettings = field(default_factory=RampSettings)
    period_s: Annotated[float, Field(gt=0, le=0.1)] = 0.02

    def monitor(self) -> SafetySettings:
        """The settings of the monitor."""
        return SafetySettings(self.rules, self.ramp, self.period_s)
