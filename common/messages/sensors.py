"""What sensors send, and the synthetic world's truth and its operator's doings."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from common.arrays import AnyArray, Image, Ranges, Transform, Vector
from common.camera import StereoCamera
from common.messages.base import SIDE, Message, Stamp

_SCAN_BOUNDS = (
    ("ranges", 0.0, 1000.0),
    ("intensities", 0.0, 65535.0),
    ("elevations", -1.5708, 1.5708),
    ("azimuths", -6.2832, 6.2832),
    ("offsets", -1.0, 1.0),
)
"""What a lidar can mean: metres, sensor's own levels, radians, seconds."""

Focal = Annotated[float, Field(gt=0, le=1e5)]
Side = Annotated[int, Field(ge=SIDE[0], le=SIDE[1])]
Wavelength = Annotated[float, Field(ge=1e-7, le=2e-5)]


class CameraModel(Message):
    """Calibration of a rectified stereo pair; see :class:`common.camera.StereoCamera`."""

    width: Side
    height: Side
    fx: Focal
    fy: Focal
    cx: Annotated[float, Field(ge=-1e5, le=1e5)]
    cy: Annotated[float, Field(ge=-1e5, le=1e5)]
    baseline: Annotated[float, Field(gt=0, le=100)]
    T_vehicle_camera: Transform
    wavelengths: tuple[Wavelength, Wavelength, Wavelength] | None = None
    transfer: Annotated[float, Field(ge=0.1, le=10)] | Literal["srgb"] = 1.0

    @model_validator(mode="after")
    def _colours_in_order(self) -> Self:
        if self.wavelengths is not None:
            red, green, blue = self.wavelengths
            if not min(red, blue) < green < max(red, blue):
                raise ValueError("the peak wavelength of green does not lie between those of red and blue")
        return self

    @classmethod
    def of(cls, camera: StereoCamera) -> Self:
        """The message of a camera."""
        return cls(**{name: getattr(camera, name) for name in cls.model_fields})

    def camera(self) -> StereoCamera:
        """The camera of this message."""
        return StereoCamera(**{name: getattr(self, name) for name in type(self).model_fields})


class StereoFrame(Message):
    """A rectified stereo pair, grey (H, W) or RGB (H, W, 3), uint8."""

    stamp: Stamp
    camera: CameraModel
    left: Image
    right: Image

    @model_validator(mode="after")
    def _images_fit(self) -> Self:
        size = (self.camera.height, self.camera.width)
        for image in (self.left, self.right):
            if image.shape not in (size, (*size, 3)):
                raise ValueError(f"an image is {image.shape}, its calibration {size}")
        if self.left.shape != self.right.shape:
            raise ValueError("one image is grey and the other is not")
        return self


class CameraFrame(Message):
    """An image of one camera of which nothing is known, grey (H, W) or RGB (H, W, 3), uint8."""

    stamp: Stamp
    image: Image

    @model_validator(mode="after")
    def _is_an_image(self) -> Self:
        shape = self.image.shape
        if len(shape) not in (2, 3) or shape[2:] not in ((), (3,)):
            raise ValueError(f"an array {shape} is no grey or RGB image")
        if not all(SIDE[0] <= side <= SIDE[1] for side in shape[:2]):
            raise ValueError(f"an image's sides have {SIDE[0]} to {SIDE[1]} pixels, not {shape[:2]}")
        return self


class LidarScan(Message):
    """One turn of a spinning lidar, organised: H beams from the top to the bottom, W columns in the order of firing.

    ``ranges`` (H, W) in metres are distances from the lidar's centre when the beam was fired, 0 where nothing came
    back; ``intensities`` (H, W) are as the sensor reports them: uint8, uint16, or float32 up to 65535. ``elevations``
    (H,) or (H, W) and ``azimuths`` (W,) or (H, W), positive to the left, are in the lidar's frame (x forward, y left,
    z up). Column j was fired ``offsets[j]`` seconds after the stamp, before it where that is negative.
    """

    stamp: Stamp
    T_vehicle_lidar: Transform
    ranges: Ranges
    intensities: AnyArray
    elevations: AnyArray
    azimuths: AnyArray
    offsets: Vector

    @model_validator(mode="after")
    def _is_a_scan(self) -> Self:
        beams, columns = self.ranges.shape
        if not 2 <= beams <= 512 or not SIDE[0] <= columns <= SIDE[1]:
            raise ValueError(f"a scan of {beams} beams and {columns} columns is of no spinning lidar")
        if self.intensities.shape != self.ranges.shape or self.offsets.shape != (columns,):
            raise ValueError("a scan has an intensity for every range and an offset for every column")
        if self.elevations.shape not in ((beams,), (beams, columns)):
            raise ValueError(f"elevations {self.elevations.shape} do not fit ranges {self.ranges.shape}")
        if self.azimuths.shape not in ((columns,), (beams, columns)):
            raise ValueError(f"azimuths {self.azimuths.shape} do not fit ranges {self.ranges.shape}")
        if self.intensities.dtype.str not in {"|u1", "<u2", "<f4"}:
            raise ValueError(f"intensities are uint8, uint16 or float32, not {self.intensities.dtype}")
        for name in ("elevations", "azimuths"):
            if getattr(self, name).dtype.str not in {"<f4", "<f8"}:
                raise ValueError(f"{name} are float32 or float64")
        return self

    @model_validator(mode="after")
    def _is_possible(self) -> Self:
        for name, least, most in _SCAN_BOUNDS:
            values = getattr(self, name)
            if values.min() < least or values.max() > most:
                raise ValueError(f"{name} are between {least:g} and {most:g}")
        return self


class WheelOdometry(Message):
    """Speed (m/s, forward) and turn rate (rad/s, to the left) as the wheels report them."""

    stamp: Stamp
    v: Annotated[float, Field(ge=-100, le=100)]
    w: Annotated[float, Field(ge=-100, le=100)]


class Joystick(Message):
    """Axes in [-1, 1], whether the dead man's switch is held, and which of the buttons are pressed."""

    stamp: Stamp
    axes: Annotated[list[Annotated[float, Field(ge=-1, le=1)]], Field(max_length=16)]
    held: bool
    buttons: Annotated[list[bool], Field(max_length=32)] = []


class Truth(Message):
    """The synthetic world's truth, for tests and reports alone: pose, and the base's own speed."""

    stamp: Stamp
    T_world_vehicle: Transform
    v: float
    w: float


class Place(Message):
    """Puts the synthetic world's robot at a pose of the plane, at rest."""

    x: float
    y: float
    yaw: float


class WorldTime(Message):
    """Sets the synthetic world's clock, and so its sun, to the moment ``stamp``."""

    stamp: Stamp
