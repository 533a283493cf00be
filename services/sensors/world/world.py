"""The synthetic world: a robot on the ground of a scene, under the sun of a moment."""

from __future__ import annotations

from datetime import datetime
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from common.camera import StereoCamera
from common.geometry import Array
from services.sensors.world.base import Base, BaseState
from services.sensors.world.cache import kept
from services.sensors.world.geometry import MATERIAL, Floats, Geometry
from services.sensors.world.imaging import Image, Imager, response_white
from services.sensors.world.lidar import Lidar, Scan
from services.sensors.world.lightmaps import LightBaker
from services.sensors.world.rays import RayCaster
from services.sensors.world.render import Renderer, white_light
from services.sensors.world.scene import Scene
from services.sensors.world.settings import WorldSettings
from services.sensors.world.spectra import band_sensitivities
from services.sensors.world.sun import Daylight, daylight
from services.sensors.world.trail import Trail

_DEFAULT = WorldSettings()


class World:
    """A scene, the light on it, a robot in it with a stereo camera, a lidar, wheels and rays to cast.

    The frame "world" has x east, y north, z up. Truth is what the properties say; sensors are :meth:`render` or
    :meth:`render_left`, :meth:`scan`, :meth:`wheel_odometry` and :meth:`cast_rays`. Not safe for threads, except that
    an image, :meth:`scan`, :meth:`step` and :meth:`set_time` may each be in one of its own once :meth:`warm_up` has
    returned.
    """

    def __init__(self, settings: WorldSettings = _DEFAULT) -> None:
        """Build the scene, or take it from the cache. Its light is made for the first image."""
        self.settings = settings
        self.scene = kept(Scene.build, settings.scene)
        self._geometry = Geometry.of(self.scene.groups, self.scene.ground_map())
        self._rays = RayCaster(self._geometry)
        self._light = daylight(settings.time, settings.latitude, settings.longitude)
        self._camera = settings.camera
        self._white = response_white(*white_light(_noon(), band_sensitivities(settings.bands)))
        self.start_camera(settings.seed + 1)
        self.lidar = Lidar(settings.lidar, self._geometry, self.scene.textures, settings.seed + 2)
        self._base = Base(settings.base, settings.seed)
        self._clock = 0.0
        self._metered = 0.0
        x, y, yaw = self.scene.demo_route()[0]
        self.place(float(x), float(y), float(yaw))

    @cached_property
    def _baker(self) -> LightBaker:
        return LightBaker(self.scene, self._geometry, self._rays)

    @cached_property
    def _renderer(self) -> Renderer:
        maps = self._baker.bake(self._light.direction)
        return Renderer(self.settings, self._geometry, self.scene, self._light, maps)

    @property
    def camera(self) -> StereoCamera:
        """The stereo camera's calibration, with its bands' peaks and its transfer curve."""
        return self._camera

    @property
    def light(self) -> Daylight:
        """Sun and sky at the world's time."""
        return self._light

    @property
    def clock(self) -> float:
        """Seconds that were stepped through."""
        return self._clock

    @property
    def T_world_vehicle(self) -> Array:
        """The robot's true pose (4, 4), standing on the ground."""
        return self.scene.terrain.standing(*self._base.pose())

    @property
    def twist(self) -> tuple[float, float]:
        """True speed and turn rate over ground, m/s and rad/s."""
        return self._base.state.twist

    @property
    def base_state(self) -> BaseState:
        """The base's state, to be stored and given to :meth:`restore`."""
        return self._base.state

    def set_time(self, time: datetime) -> None:
        """Move the sun; shadows are computed anew, in about a second, once it has moved far enough."""
        self._light = daylight(time, self.settings.latitude, self.settings.longitude)
        if "_renderer" not in vars(self):
            return
        baked = self._renderer.baked_for
        moved = np.degrees(np.arccos(np.clip(self._light.direction @ baked, -1.0, 1.0)))
        maps = self._baker.bake(self._light.direction) if moved > self.settings.bake_degrees else None
        self._renderer.set_light(self._light, maps)

    def start_camera(self, seed: int) -> None:
        """Switch the camera on anew: its noise is drawn from ``seed``, its exposure set by the next image."""
        self._imager = Imager(self.settings.imaging, self._white, seed)

    def place(self, x: float, y: float, yaw: float) -> None:
        """Put the robot down at rest: metres, metres, radians."""
        self.restore(BaseState(x, y, yaw))

    def restore(self, state: BaseState) -> None:
        """Go on from a stored state. No command counts as heard, so the base brakes until there is one."""
        self._base = Base(self.settings.base, self.settings.seed, state)
        self._trail = Trail(self._clock, state)

    def step(self, dt: float, command: tuple[float, float] | None) -> None:
        """Move on by ``dt`` seconds; ``command`` (m/s, rad/s) is one that arrives now, None where none does.

        Raises:
            ValueError: the command is not finite.
        """
        if command is not None:
            self._base.command(*command, now=self._clock)
        self._clock += dt
        self._base.step(dt, self._clock)
        self._trail.add(self._clock, self._base.state)

    def wheel_odometry(self) -> tuple[float, float]:
        """Speed and turn rate as the wheels report them, m/s and rad/s."""
        return self._base.wheel_odometry()

    def render(self) -> tuple[Image, Image]:
        """The left and the right image now, RGB (H, W, 3)."""
        left, right = self._renderer.stereo(self.T_world_vehicle)
        self._meter(left)
        return self._imager.expose(left), self._imager.expose(right)

    def render_left(self) -> Image:
        """The left image alone, for half the time."""
        left = self._renderer.left(self.T_world_vehicle)
        self._meter(left)
        return self._imager.expose(left)

    def _meter(self, light: Floats) -> None:
        """Let the exposure follow the light (H, W, 3) of an image for the time since the last one."""
        clock = self._clock
        self._imager.meter(light, clock - self._metered)
        self._metered = clock

    def scan(self, clock: float | None = None) -> Scan:
        """The lidar's turn that ends at a time of :attr:`clock`, by default now; up to a second of it was driven.

        A time that the base has yet to be stepped to is seen from where it is going.
        """
        end = self._clock if clock is None else clock
        return self.scan_from(self._trail.poses(end + self.lidar.times))

    def scan_from(self, places: Array) -> Scan:
        """A turn of the lidar whose columns are fired from ``[x, y, yaw]`` (W, 3), wherever the robot is."""
        return self.lidar.scan(self._rays, self.scene.terrain.standing(*places.T))

    def render_depth(self) -> NDArray[np.float32]:
        """True depth (H, W) along the left camera's axis at pixel centres, metres; infinite for the sky."""
        return self._renderer.depth(self.T_world_vehicle)

    def cast_rays(self, origins: Array, directions: Array) -> tuple[Array, NDArray[np.int64], Array]:
        """Ranges (N,) in metres, material indices (N,) and unit normals (N, 3) towards the origin.

        ``origins`` and ``directions`` (N, 3) in the world frame, directions of length one. A miss has an
        infinite range, material -1 and a zero normal.
        """
        distance, polygon = self._rays.first_hits(origins, directions)
        hit = polygon >= 0
        index = np.where(hit, polygon, 0)
        normal = self._geometry.normals[index]
        towards = np.where(np.einsum("ni,ni->n", normal, np.asarray(directions)) > 0.0, -1.0, 1.0)
        normal = np.where(hit[:, None], normal * towards[:, None], 0.0)
        return distance, np.where(hit, self._geometry.indices[index, MATERIAL], -1), normal

    def warm_up(self, *, cameras: bool = True, lidar: bool = True) -> None:
        """Make the light, and compile or load from the cache what images and scans need; changes nothing seen."""
        if lidar:
            self.lidar.warm_up(self._rays)
        if not cameras:
            return
        self._renderer.stereo(self.T_world_vehicle)
        imager = Imager(self.settings.imaging, 1.0, 0)
        tiny = np.ones((8, 8, 3), np.float32)
        imager.meter(tiny, 0.0)
        imager.expose(tiny)


def _noon() -> Daylight:
    """The light that defines gain 1: clear noon on the longest day at the default place."""
    return daylight(_DEFAULT.time, _DEFAULT.latitude, _DEFAULT.longitude)
