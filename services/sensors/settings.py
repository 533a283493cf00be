"""``[sensors]``: which driver runs, and the world that the synthetic one drives in."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

from services.sensors.world.settings import WorldSettings

Sensor = Literal["stereo", "camera", "lidar"]


@dataclass(frozen=True, slots=True)
class Settings:
    """What this robot senses with.

    Attributes:
        driver: ``synthetic``, the simulated world with its own robot base, or ``none``, where something else
            (``vtr play``) publishes the sensors' topics.
        simulate: the sensors that the synthetic driver has besides its wheels: a ``stereo`` pair, one ``camera``, which
            is the pair's left one, a spinning ``lidar``. What is not named costs nothing.
        camera: name of the stereo pair, and of the camera, in its topic.
        lidar: name of the lidar in its topic.
        frame_rate: stereo pairs, or images, a second; the lidar's rate is one of the world's own settings.
        base_rate: steps of the base and samples of wheel odometry a second.
        world: the synthetic world.
    """

    driver: Literal["synthetic", "none"] = "synthetic"
    simulate: tuple[Sensor, ...] = ("stereo",)
    camera: str = "front"
    lidar: str = "top"
    frame_rate: float = 10.0
    base_rate: float = 50.0
    world: WorldSettings = field(default_factory=WorldSettings)

    def __post_init__(self) -> None:
        """Refuses rates that are none, and a robot without a sensor.

        Raises:
            ValueError: a rate is not positive, or no sensor is named, or one is twice.
        """
        for name in ("frame_rate", "base_rate"):
            if not getattr(self, name) > 0.0:
                raise ValueError(f"`{name}` is {getattr(self, name)} Hz; it must be positive.")
        if not self.simulate or len(set(self.simulate)) != len(self.simulate):
            raise ValueError(
                "`simulate` names one sensor or several, each once; a robot without any has driver 'none'."
            )

    @property
    def sees(self) -> bool:
        """Whether a camera is simulated."""
        return "stereo" in self.simulate or "camera" in self.simulate

    @property
    def scans(self) -> bool:
        """Whether the lidar is simulated."""
        return "lidar" in self.simulate
