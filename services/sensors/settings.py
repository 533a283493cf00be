"""``[sensors]``: which driver runs, the cameras of the real one, and the world that the synthetic one drives in."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from common.camera import Transfer
from services.sensors.ros2.settings import Ros2Settings
from services.sensors.world.settings import WorldSettings

Sensor = Literal["stereo", "camera", "lidar"]


@dataclass(frozen=True, slots=True)
class CameraSettings:
    """``[sensors.cameras]``: the capture devices of the driver ``cameras``. Their image size is the calibration's.

    Attributes:
        devices: the left and the right camera, or one that delivers both side by side: numbers, or paths as
            ``/dev/v4l/by-id/...``, which stay the same when cables are moved.
        right_first: whether the first device, or half of the image, is the right camera's.
        rate: images a second that the devices are asked for; None leaves it to them.
        fourcc: code of the pixel format that they are asked for, as ``MJPG``; empty leaves it to them.
        grey: whether colours are dropped, which costs the illumination-invariant stream and saves half of the work.
        max_skew: seconds that the two images of a pair may be apart, where the devices tell it.
        wavelengths: where red, green and blue are most sensitive, metres; see :class:`common.camera.StereoCamera`.
        transfer: the cameras' transfer curve, likewise.
    """

    devices: tuple[int | str, ...] = (0, 1)
    right_first: bool = False
    rate: float | None = None
    fourcc: str = ""
    grey: bool = False
    max_skew: float = 0.005
    wavelengths: tuple[float, float, float] | None = None
    transfer: Transfer = 1.0

    def __post_init__(self) -> None:
        """Refuses what is no pair.

        Raises:
            ValueError: not one device or two, or a rate, a skew or a code that is none.
        """
        if len(self.devices) not in (1, 2) or len(set(self.devices)) != len(self.devices):
            raise ValueError("`devices` names the left and the right camera, or one that delivers both side by side.")
        if self.rate is not None and not self.rate > 0.0:
            raise ValueError(f"`rate` is {self.rate} Hz; it must be positive.")
        if not self.max_skew > 0.0:
            raise ValueError(f"`max_skew` is {self.max_skew} s; it must be positive.")
        if len(self.fourcc) not in (0, 4):
            raise ValueError("`fourcc` is a code of four characters, as 'MJPG'.")


@dataclass(frozen=True, slots=True)
class Settings:
    """What this robot senses with.

    Attributes:
        driver: ``synthetic``, the simulated world with its own robot base; ``cameras``, a real stereo pair;
            ``ros2``, a ROS 2 robot; or ``none``, where something else (``vtr play``) publishes the sensors' topics.
        simulate: the sensors that the synthetic driver has besides its wheels: a ``stereo`` pair, one ``camera``, which
            is the pair's left one, a spinning ``lidar``. What is not named costs nothing.
        camera: name of the stereo pair, and of the camera, in its topic.
        lidar: name of the lidar in its topic.
        frame_rate: stereo pairs, or images, a second, and of the driver ``ros2`` scans; the synthetic lidar's rate is
            one of the world's own settings.
        calibration: file of ``vtr calibrate`` by which the driver ``cameras`` rectifies, and ``ros2`` where its camera
            infos are not to be used; a relative path begins at the robot's TOML file.
        cameras: the devices of the driver ``cameras``; colours and transfer curve are those of ``ros2`` too.
        ros2: the graph of the driver ``ros2``.
        base_rate: steps of the base and samples of wheel odometry a second.
        world: the synthetic world.
    """

    driver: Literal["synthetic", "cameras", "ros2", "none"] = "synthetic"
    simulate: tuple[Sensor, ...] = ("stereo",)
    camera: str = "front"
    lidar: str = "top"
    frame_rate: float = 10.0
    calibration: Path | None = None
    cameras: CameraSettings = field(default_factory=CameraSettings)
    ros2: Ros2Settings = field(default_factory=Ros2Settings)
    base_rate: float = 50.0
    world: WorldSettings = field(default_factory=WorldSettings)

    def __post_init__(self) -> None:
        """Refuses rates that are none, and a robot without a sensor.

        Raises:
            ValueError: a rate is not positive, or no sensor is named, or one is twice, or none of ROS.
        """
        for name in ("frame_rate", "base_rate"):
            if not getattr(self, name) > 0.0:
                raise ValueError(f"`{name}` is {getattr(self, name)} Hz; it must be positive.")
        wanted = self.ros2.inputs
        if self.driver == "ros2" and not (wanted.left or wanted.image or wanted.points):
            raise ValueError(
                "The driver 'ros2' needs the topics of what the robot senses with: name left and right, image, or "
                "points in [sensors.ros2.inputs]."
            )
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
