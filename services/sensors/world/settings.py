"""What the synthetic world is made of: its seed, its place and time, its camera, lidar, base and noise."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from datetime import UTC, datetime

import numpy as np

from common.camera import OPTICAL_IN_VEHICLE, StereoCamera
from common.geometry import Array, so3_exp, transform

NOON = datetime(2026, 6, 21, 11, 0, tzinfo=UTC)
"""Near solar noon at the default place on the longest day."""


def forward_camera(height: float = 0.8, pitch: float = 0.12) -> Array:
    """``T_vehicle_camera`` (4, 4) of a camera 0.3 m ahead of the vehicle's origin.

    ``height`` metres above the ground, looking ahead and down by ``pitch`` radians.
    """
    down = transform(so3_exp([0.0, pitch, 0.0]), [0.3, 0.12, height])
    return np.asarray(down @ OPTICAL_IN_VEHICLE)


def default_rig() -> StereoCamera:
    """A stereo camera of 640x400 pixels, 74 degrees wide, with a baseline of 0.24 m."""
    return StereoCamera(640, 400, 425.0, 425.0, 319.5, 199.5, 0.24, forward_camera())


@dataclass(frozen=True, slots=True)
class SceneSettings:
    """What stands in the world, drawn from ``seed``.

    Attributes:
        seed: of every random choice; equal seeds give equal scenes.
        extent: side of the square that is furnished and has cast shadows on its ground, metres.
        horizon: distance to which the ground goes on beyond it, metres.
        relief: standard deviation of the ground's height, metres.
        route_length: length of the demo route, metres.
        clearance: least distance of any obstacle from the demo route's centre line, metres.
        wind: which of the wind's arrangements leaves and grass are in; everything else stands still.
        trees, bushes, boxes, stones, tufts, houses, walls, fences: how many of each are tried; what
            would stand in the route's way or in another object is left out.
    """

    seed: int = 7
    extent: float = 96.0
    horizon: float = 420.0
    relief: float = 0.35
    route_length: float = 72.0
    clearance: float = 1.6
    wind: int = 0
    trees: int = 40
    bushes: int = 26
    boxes: int = 16
    stones: int = 140
    tufts: int = 420
    houses: int = 4
    walls: int = 6
    fences: int = 4


@dataclass(frozen=True, slots=True)
class BandSettings:
    """The colour camera's bands, Gaussian in wavelength.

    Attributes:
        peaks: wavelengths of greatest sensitivity of red, green and blue, metres.
        widths: full widths at half maximum, metres. Zero width would make the invariant image exact.
    """

    peaks: tuple[float, float, float] = (610e-9, 540e-9, 460e-9)
    widths: tuple[float, float, float] = (70e-9, 75e-9, 65e-9)


@dataclass(frozen=True, slots=True)
class ImagingSettings:
    """From light to pixels.

    Attributes:
        target: mean grey level that auto exposure seeks, as a part of full scale.
        exposure_seconds: time constant of auto exposure.
        full_well: electrons of a saturated pixel at gain 1, which sets the shot noise.
        read_noise: standard deviation of the noise of a dark pixel, electrons.
        gamma: exponent of the transfer curve; 1 is linear.
        gain_limit: the greatest amplification, relative to an exposure for a white surface in clear noon sun.
        samples: 1, or 2 for 2x2 samples of geometry in a pixel, which smooths silhouettes for half as much time again.
    """

    target: float = 0.36
    exposure_seconds: float = 1.0
    full_well: float = 12000.0
    read_noise: float = 12.0
    gamma: float = 1.0
    gain_limit: float = 200.0
    samples: int = 1


@dataclass(frozen=True, slots=True)
class LidarSettings:
    """A spinning lidar, whose beams lie above each other and fire together, one column after the other.

    Attributes:
        beams: how many there are; their elevations are even from ``highest`` to ``lowest``.
        lowest, highest: elevations of the outer beams, radians.
        beam_table: elevations of all beams from the top to the bottom, radians; empty for even ones.
        columns: firings a turn.
        rate: turns a second.
        position: of the lidar's centre in the vehicle's frame, metres.
        rotation: of the lidar's frame (x forward, y left, z up) in the vehicle's, a rotation vector, radians.
        divergence: angle of the cone within which a beam's spot lies, radians; textures are filtered over the spot.
        near, far: ranges outside of which nothing is measured, metres.
        reach: distance at which a surface of 10 % reflectance that faces the beam is found half of the time, metres.
        threshold: photons that a return needs to be found.
        full_scale: distance from which on a white surface that faces the beam does not saturate, metres.
        range_noise: standard deviations of a strong return's range and of one at the threshold, metres.
    """

    beams: int = 32
    lowest: float = -0.436
    highest: float = 0.262
    beam_table: tuple[float, ...] = ()
    columns: int = 1024
    rate: float = 10.0
    position: tuple[float, float, float] = (0.0, 0.0, 1.2)
    rotation: tuple[float, float, float] = (0.0, 0.0, 0.0)
    divergence: float = 0.006
    near: float = 0.4
    far: float = 120.0
    reach: float = 45.0
    threshold: float = 8.0
    full_scale: float = 2.5
    range_noise: tuple[float, float] = (0.008, 0.05)

    def __post_init__(self) -> None:
        """Refuses what no lidar is.

        Raises:
            ValueError: a number is not positive, or the beams or ranges are not in order.
        """
        for name in ("rate", "divergence", "near", "reach", "threshold", "full_scale"):
            if not getattr(self, name) > 0.0:
                raise ValueError(f"`{name}` is {getattr(self, name)}; it must be positive")
        if not self.near < self.far:
            raise ValueError("`near` must be less than `far`")
        if not 2 <= len(self.elevations) <= 256 or not 16 <= self.columns <= 8192:
            raise ValueError("a lidar has 2 to 256 beams and 16 to 8192 columns")
        if not (np.diff(self.elevations) < 0.0).all() or np.abs(self.elevations).max() > np.pi / 2.0:
            raise ValueError("beams go from the highest elevation to the lowest, within a quarter turn of level")
        if min(self.range_noise) < 0.0:
            raise ValueError("`range_noise` must not be negative")

    @property
    def elevations(self) -> Array:
        """Of the beams (H,) from the top to the bottom, radians."""
        return np.array(self.beam_table) if self.beam_table else np.linspace(self.highest, self.lowest, self.beams)

    @property
    def T_vehicle_lidar(self) -> Array:
        """The mounting (4, 4)."""
        return transform(so3_exp(self.rotation), self.position)


@dataclass(frozen=True, slots=True)
class BaseSettings:
    """The wheeled base: limits, delays and slip.

    Attributes:
        speed_limit, turn_limit: m/s and rad/s beyond which commands are clamped.
        acceleration, turn_acceleration: what the motors can do, m/s^2 and rad/s^2.
        lag: time constant of the speed controller, seconds.
        delay: from a command's acceptance to its effect, seconds.
        timeout: seconds after the last accepted command at which the base brakes by itself.
        braking: deceleration of that stop, and of any that is commanded, m/s^2; the turn rate falls with it.
        slip: standard deviation of the part of the wheels' motion that the ground does not get.
        turn_slip: mean part of the turn rate that is lost, in addition.
        curve_slip: growth of slip with lateral acceleration, per m/s^2.
        slip_seconds: correlation time of slip.
        odometry_noise: standard deviations of wheel odometry, as parts of its v and w.
    """

    speed_limit: float = 2.5
    turn_limit: float = 1.8
    acceleration: float = 2.0
    turn_acceleration: float = 4.0
    lag: float = 0.12
    delay: float = 0.06
    timeout: float = 0.3
    braking: float = 8.0
    slip: float = 0.015
    turn_slip: float = 0.04
    curve_slip: float = 0.02
    slip_seconds: float = 2.0
    odometry_noise: tuple[float, float] = (0.005, 0.01)


@dataclass(frozen=True, slots=True)
class WorldSettings:
    """Everything that a :class:`~services.sensors.world.World` is built from.

    Attributes:
        seed: of slip and noise; the scene has a seed of its own.
        time: the moment that sets the sun, with a time zone.
        latitude, longitude: degrees, north and east positive; the world's x is east, y is north.
        bake_degrees: how far the sun moves before shadows are computed anew.
        clouds: part of the sky that is clouded, 0 to 1; clouds are drawn, they cast no shadow.
        scene: what stands in it.
        rig: the stereo camera; for programs, no file can name another one.
        bands: the camera's colours.
        imaging: from light to pixels.
        lidar: the spinning lidar.
        base: the wheels.
    """

    seed: int = 1
    time: datetime = NOON
    latitude: float = 50.08
    longitude: float = 14.42
    bake_degrees: float = 0.5
    clouds: float = 0.35
    scene: SceneSettings = field(default_factory=SceneSettings)
    rig: StereoCamera = field(default_factory=default_rig)
    bands: BandSettings = field(default_factory=BandSettings)
    imaging: ImagingSettings = field(default_factory=ImagingSettings)
    lidar: LidarSettings = field(default_factory=LidarSettings)
    base: BaseSettings = field(default_factory=BaseSettings)

    @property
    def camera(self) -> StereoCamera:
        """The rig's calibration with the bands' peaks and the transfer curve."""
        return replace(self.rig, wavelengths=self.bands.peaks, transfer=self.imaging.gamma)
