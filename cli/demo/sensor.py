"""What the demo's robot drives by."""

from __future__ import annotations

from enum import StrEnum


class Sensor(StrEnum):
    """A robot's ``sensor``, as its configuration names it."""

    STEREO = "stereo"
    LIDAR = "lidar"
    BEARING = "bearing"

    @property
    def simulated(self) -> str:
        """What the synthetic world simulates for it, as ``[sensors] simulate`` names it."""
        return "camera" if self is Sensor.BEARING else self.value
