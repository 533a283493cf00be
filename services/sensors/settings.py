"""``[sensors]``: which driver runs, and the world that the synthetic one drives in."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

from services.sensors.world.settings import WorldSettings


@dataclass(frozen=True, slots=True)
class Settings:
    """What this robot senses with.

    Attributes:
        driver: ``synthetic``, the simulated world with its own robot base, or ``none``, where something else
            (``vtr play``) publishes the sensors' topics.
        camera: name of the stereo camera in its topic.
        frame_rate: stereo pairs a second.
        base_rate: steps of the base and samples of wheel odometry a second.
        world: the synthetic world.
    """

    driver: Literal["synthetic", "none"] = "synthetic"
    camera: str = "front"
    frame_rate: float = 10.0
    base_rate: float = 50.0
    world: WorldSettings = field(default_factory=WorldSettings)

    def __post_init__(self) -> None:
        """Refuses rates that are none.

        Raises:
            ValueError: a rate is not positive.
        """
        for name in ("frame_rate", "base_rate"):
            if not getattr(self, name) > 0.0:
                raise ValueError(f"`{name}` is {getattr(self, name)} Hz; it must be positive.")
