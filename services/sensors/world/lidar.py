"""A spinning lidar in the synthetic world: what it measures while the vehicle moves on under it.

A return is found, and measured, by its photons. Their number N follows from the reflectance at the spot, the incidence
and the range r as rho cos(theta) / r^2 does. Counting them has a deviation of sqrt(N), so that the deviation of their
square root is a half whatever N is (Anscombe, *Biometrika* 35, 1948). The sensor reports that square root, as detectors
of a wide dynamic range do: its intensity falls as 1 / r, and range times intensity depends on the surface alone.

The sensor brings its own light: sun, sky and shadows do not enter.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from common.geometry import Array
from services.sensors.world.geometry import Floats, Geometry
from services.sensors.world.rays import RayCaster
from services.sensors.world.settings import LidarSettings
from services.sensors.world.spectra import REFLECTANCES_INFRARED
from services.sensors.world.spots import reflected
from services.sensors.world.textures import TextureSet

_BLOCK = 8192
"""Rays that are cast at once; other threads get their turn in between."""
_DARK = 0.1
"""Reflectance of the surface that the sensor's reach is stated for."""
_HALF = 0.5
"""Standard deviation of the square root of a number of photons."""


@dataclass(frozen=True, slots=True)
class Scan:
    """One turn of H beams in W columns.

    Attributes:
        ranges: (H, W) float32 from the lidar's centre at the moment of firing, metres; 0 without a return.
        intensities: (H, W) uint8 square root of the returned light, 0 without a return.
    """

    ranges: Floats
    intensities: NDArray[np.uint8]


class Lidar:
    """A spinning lidar: its columns go from behind over the left, ahead and the right to behind again.

    Attributes:
        elevations: (H,) of the beams from the top to the bottom, radians.
        azimuths: (W,) of the columns in the order of firing, radians, positive to the left.
        times: (W,) of the columns before the turn's end, seconds: the last one is 0.
        T_vehicle_lidar: (4, 4) its mounting.
    """

    def __init__(self, settings: LidarSettings, geometry: Geometry, textures: TextureSet, seed: int) -> None:
        self._settings, self._geometry, self._textures = settings, geometry, textures
        self.start(seed)
        turn = (np.arange(settings.columns) + 0.5) / settings.columns
        self.elevations = settings.elevations
        self.azimuths: Array = np.pi * (1.0 - 2.0 * turn)
        self.times: Array = (np.arange(settings.columns) - (settings.columns - 1)) / (settings.columns * settings.rate)
        self.T_vehicle_lidar = settings.T_vehicle_lidar
        azimuth, elevation = self.azimuths[:, None], self.elevations[None, :]
        flat, level = np.cos(elevation), np.ones_like(azimuth)
        rays = [np.cos(azimuth) * flat, np.sin(azimuth) * flat, level * np.sin(elevation)]
        self._rays: Floats = np.stack(rays, axis=-1).astype(np.float32)

    def start(self, seed: int) -> None:
        """Switch the lidar on anew: its noise is drawn from ``seed``."""
        self._rng = np.random.default_rng(seed)

    def scan(self, rays: RayCaster, T_world_vehicle: Array) -> Scan:
        """The scan of a vehicle that is at ``T_world_vehicle`` (W, 4, 4) when each column is fired."""
        origins, directions = self._aimed(T_world_vehicle)
        hits = [
            rays.first_hits(origins[k : k + _BLOCK], directions[k : k + _BLOCK]) for k in range(0, len(origins), _BLOCK)
        ]
        distance, polygon = (np.concatenate(parts) for parts in zip(*hits, strict=True))
        light = np.empty(len(distance), np.float32)
        g, t = self._geometry, self._textures
        reflected(
            origins, directions, distance, polygon, self._settings.divergence, g.normals, g.maps, g.weights, g.indices,
            t.texels, t.starts, t.logs, REFLECTANCES_INFRARED, light,
        )  # fmt: skip
        ranges, intensities = self._measured(light, distance.astype(np.float32))
        shape = self._rays.shape[:2]
        return Scan(np.ascontiguousarray(ranges.reshape(shape).T), np.ascontiguousarray(intensities.reshape(shape).T))

    def warm_up(self, rays: RayCaster) -> None:
        """Prepare the rays, and compile, or load from the cache, what else :meth:`scan` needs."""
        rays.first_hits(np.zeros((1, 3)), np.array([[0.0, 0.0, 1.0]]))
        g, t = self._geometry, self._textures
        nothing = np.zeros((0, 3), np.float32)
        reflected(
            nothing, nothing, np.zeros(0), np.zeros(0, np.int64), 1.0, g.normals, g.maps, g.weights, g.indices,
            t.texels, t.starts, t.logs, REFLECTANCES_INFRARED, np.zeros(0, np.float32),
        )  # fmt: skip

    def _aimed(self, T_world_vehicle: Array) -> tuple[Floats, Floats]:
        """Origins and directions (W * H, 3) of the rays in the world, one column after the other."""
        T = (T_world_vehicle @ self.T_vehicle_lidar).astype(np.float32)
        directions = np.matmul(self._rays, np.swapaxes(T[:, :3, :3], -1, -2)).reshape(-1, 3)
        return np.repeat(T[:, :3, 3], self._rays.shape[1], axis=0), directions

    def _measured(self, light: Floats, distance: Floats) -> tuple[Floats, NDArray[np.uint8]]:
        """Ranges (N,) and intensities (N,) of returned light (N,) from distances (N,), infinite for a miss."""
        s = self._settings
        # A threshold of photons from a dark surface at the sensor's reach sets how many there are elsewhere.
        photons = s.threshold * s.reach**2 / _DARK
        with np.errstate(divide="ignore"):
            amplitude = np.sqrt(photons * light) / distance
        amplitude += np.float32(_HALF) * self._rng.standard_normal(len(light), np.float32)
        least = np.float32(np.sqrt(s.threshold))
        found = (amplitude > least) & (light > 0.0) & (distance > s.near) & (distance < s.far)
        amplitude = np.maximum(amplitude, least)
        strong, weak = np.float32(s.range_noise[0]), np.float32(s.range_noise[1])
        deviation = np.hypot(strong, weak * least / amplitude)
        measured = distance + deviation * self._rng.standard_normal(len(light), np.float32)
        level = np.minimum(amplitude * np.float32(255.0 * s.full_scale / np.sqrt(photons)) + np.float32(0.5), 255.0)
        return (
            np.where(found, measured, np.float32(0.0)).astype(np.float32),
            np.where(found, level, 0.0).astype(np.uint8),
        )
