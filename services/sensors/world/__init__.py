"""The synthetic world: terrain and things under a moving sun, and a robot that sees and drives in it."""

from services.sensors.world.base import Base, BaseState
from services.sensors.world.lidar import Lidar, Scan
from services.sensors.world.scene import Scene
from services.sensors.world.settings import (
    BandSettings,
    BaseSettings,
    ImagingSettings,
    LidarSettings,
    SceneSettings,
    WorldSettings,
    default_rig,
)
from services.sensors.world.sun import Daylight, daylight, sun_angles
from services.sensors.world.world import World

__all__ = [
    "BandSettings",
    "Base",
    "BaseSettings",
    "BaseState",
    "Daylight",
    "ImagingSettings",
    "Lidar",
    "LidarSettings",
    "Scan",
    "Scene",
    "SceneSettings",
    "World",
    "WorldSettings",
    "daylight",
    "default_rig",
    "sun_angles",
]
