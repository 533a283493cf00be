"""Drives of one route, rendered or scanned frame by frame, at many times of day: what localization is evaluated on."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from datetime import datetime

import numpy as np
from numpy.typing import NDArray

from common.camera import StereoCamera
from common.geometry import Array
from services.sensors.world.imaging import Image
from services.sensors.world.lidar import Scan
from services.sensors.world.world import World


@dataclass(frozen=True, slots=True)
class DrivingSettings:
    """How a route is driven: nobody drives it twice the same.

    Attributes:
        spacing: between frames along the path, metres.
        speed: m/s, which the stamps and the auto exposure follow.
        sway: standard deviation of the lateral distance from the route, metres.
        sway_length: shortest wavelength of the sway, metres.
        length: metres of the route that are driven; None for all of it.
    """

    spacing: float = 0.3
    speed: float = 1.2
    sway: float = 0.1
    sway_length: float = 12.0
    length: float | None = None

    def __post_init__(self) -> None:
        """Refuses what is no drive.

        Raises:
            ValueError: a spacing, speed, wavelength or length is not positive, or the sway is negative.
        """
        for name in ("spacing", "speed", "sway_length", "length"):
            value = getattr(self, name)
            if value is not None and not value > 0.0:
                raise ValueError(f"`{name}` is {value}; it must be positive.")
        if not self.sway >= 0.0:
            raise ValueError(f"`sway` is {self.sway}; it must not be negative.")


_WAVES = 4


def drive(route: Array, settings: DrivingSettings, rng: np.random.Generator) -> Array:
    """Poses (M, 3) ``[x, y, yaw]`` of one drive along a route (N, 3) of the same, metres and radians.

    The drive sways beside the route by a sum of sines of random phases, points where it goes, and takes its first
    frame somewhere within the first spacing, so that two drives have no frame in common.
    """
    travelled = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(route[:, :2], axis=0), axis=1))])
    wavelengths = settings.sway_length * np.geomspace(1.0, 4.0, _WAVES)
    phases = rng.uniform(0.0, 2.0 * np.pi, _WAVES)
    # Sines of amplitude a have a variance of a^2 / 2 each.
    amplitude = settings.sway * np.sqrt(2.0 / _WAVES)
    offset = amplitude * np.sin(2.0 * np.pi * travelled[:, None] / wavelengths + phases).sum(axis=1)
    normal = np.stack([-np.sin(route[:, 2]), np.cos(route[:, 2])], axis=1)
    xy = route[:, :2] + offset[:, None] * normal
    driven = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(xy, axis=0), axis=1))])
    heading = np.gradient(xy, driven, axis=0)
    yaw = np.unwrap(np.arctan2(heading[:, 1], heading[:, 0]))
    end = driven[-1] if settings.length is None else min(driven[-1], settings.length)
    at = np.arange(rng.uniform(0.0, settings.spacing), end, settings.spacing)
    return np.stack([np.interp(at, driven, values) for values in (*xy.T, yaw)], axis=1)


@dataclass(frozen=True, slots=True)
class TraversalPair:
    """One rectified pair: its stamp in nanoseconds, and images (H, W, 3) RGB, uint8."""

    stamp_ns: int
    left: Image
    right: Image


class Traversal:
    """A drive through a world at a time of day, as a recording whose pairs are rendered while it is iterated over.

    The world has one sun and one camera: iterate over one traversal of a world at a time.
    """

    def __init__(self, world: World, poses: Array, time: datetime, settings: DrivingSettings, seed: int) -> None:
        """``poses`` (N, 3) ``[x, y, yaw]`` are those of the frames, ``seed`` that of the camera's noise."""
        self._world, self._poses, self._time, self._seed = world, poses, time, seed
        self._period = settings.spacing / settings.speed
        start = round(time.timestamp() * 1e9)
        self.stamps_ns: NDArray[np.int64] = start + np.arange(len(poses)) * round(self._period * 1e9)
        self.name = f"{time:%H:%M}"

    @classmethod
    def of(cls, world: World, time: datetime, settings: DrivingSettings, seed: int) -> Traversal:
        """A drive along the world's demo route; the same seed gives the same drive with the same noise."""
        poses = drive(world.scene.demo_route(), settings, np.random.default_rng(seed))
        return cls(world, poses, time, settings, seed)

    def __len__(self) -> int:
        return len(self._poses)

    @property
    def camera(self) -> StereoCamera:
        """The world's stereo camera."""
        return self._world.camera

    @property
    def poses_truth(self) -> Array:
        """True poses ``T_world_left`` (N, 4, 4)."""
        standing = self._world.scene.terrain.standing
        return np.array([standing(*pose) @ self.camera.T_vehicle_camera for pose in self._poses])

    def __iter__(self) -> Iterator[TraversalPair]:
        """Render the pairs in order, with the sun where it is at the traversal's time."""
        self._world.set_time(self._time)
        self._world.start_camera(self._seed)
        for stamp, (x, y, yaw) in zip(self.stamps_ns, self._poses, strict=True):
            self._world.place(float(x), float(y), float(yaw))
            self._world.step(self._period, None)
            yield TraversalPair(int(stamp), *self._world.render())


class ScanTraversal:
    """A drive through a world with its lidar, whose scans are made while it is iterated over, one a frame.

    The vehicle moves on during each turn, as :class:`Traversal`'s does from frame to frame. No light is needed.
    """

    def __init__(self, world: World, poses: Array, settings: DrivingSettings, seed: int) -> None:
        """``poses`` (N, 3) ``[x, y, yaw]`` are those at the end of each turn, ``seed`` that of the lidar's noise."""
        self._world, self._poses, self._seed = world, poses, seed
        self._clock = np.arange(len(poses)) * (settings.spacing / settings.speed)
        self.stamps_ns: NDArray[np.int64] = np.rint(self._clock * 1e9).astype(np.int64)

    @classmethod
    def of(cls, world: World, settings: DrivingSettings, seed: int) -> ScanTraversal:
        """A drive along the world's demo route; the same seed gives the same drive with the same noise."""
        return cls(world, drive(world.scene.demo_route(), settings, np.random.default_rng(seed)), settings, seed)

    def __len__(self) -> int:
        return len(self._poses)

    @property
    def poses_truth(self) -> Array:
        """True poses ``T_world_lidar`` (N, 4, 4) at the stamps, when the turns end."""
        return np.asarray(self._world.scene.terrain.standing(*self._poses.T) @ self._world.lidar.T_vehicle_lidar)

    def __iter__(self) -> Iterator[tuple[int, Scan]]:
        """Stamps in nanoseconds and scans, in order."""
        lidar = self._world.lidar
        lidar.start(self._seed)
        for stamp, end in zip(self.stamps_ns, self._clock, strict=True):
            at = end + lidar.times
            places = np.stack([np.interp(at, self._clock, values) for values in self._poses.T], axis=-1)
            yield int(stamp), self._world.scan_from(places)
