"""``[estimator]``: the sensors' pipelines, the localization chain and the submaps at hand."""

from __future__ import annotations

from dataclasses import dataclass, field

from services.estimator.bearing.settings import BearingSettings
from services.estimator.chain import ChainSettings
from services.estimator.experiences import ExperienceSettings
from services.estimator.joints import JointSettings
from services.estimator.lidar.settings import LidarSettings
from services.estimator.merging import ClosureSettings
from services.estimator.relocalization import RelocalizationSettings
from services.estimator.route_localizer import WindowSettings
from services.estimator.stereo.settings import StereoSettings
from services.estimator.wheels import WheelSettings


@dataclass(frozen=True, slots=True)
class Settings:
    """How the robot estimates its motion and its place.

    Attributes:
        camera: name of the camera's topic.
        scanner: name of the lidar's topic.
        stereo: the five stages of a stereo camera.
        lidar: the five stages of a spinning lidar.
        bearing: teach and repeat by one camera's bearing and the wheels.
        chain: the localization chain.
        window: submaps that are fetched and searched.
        experiences: which recorded experiences are joined to the route's map.
        relocalization: how a robot that knows nothing of its place is found.
        joints: how the next map of a plan is looked for at a route's end.
        closures: when a loop closure is offered while a map is taught.
        wheels: how far wheel odometry is believed.
    """

    camera: str = "front"
    scanner: str = "top"
    stereo: StereoSettings = field(default_factory=StereoSettings)
    lidar: LidarSettings = field(default_factory=LidarSettings)
    bearing: BearingSettings = field(default_factory=BearingSettings)
    chain: ChainSettings = field(default_factory=ChainSettings)
    window: WindowSettings = field(default_factory=WindowSettings)
    experiences: ExperienceSettings = field(default_factory=ExperienceSettings)
    relocalization: RelocalizationSettings = field(default_factory=RelocalizationSettings)
    joints: JointSettings = field(default_factory=JointSettings)
    closures: ClosureSettings = field(default_factory=ClosureSettings)
    wheels: WheelSettings = field(default_factory=WheelSettings)
