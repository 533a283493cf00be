"""Stereo images of the scene: what the compiled kernels need, kept ready, and one call a pair."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from common.geometry import Array
from services.sensors.world.geometry import CHART_START, MATERIAL, Floats, Geometry
from services.sensors.world.lightmaps import LightMaps
from services.sensors.world.raster import rasterise
from services.sensors.world.scene import Scene
from services.sensors.world.settings import WorldSettings
from services.sensors.world.shade import SCRATCH, WORDS, shade
from services.sensors.world.spectra import REFLECTANCES, band_sensitivities, illuminant, responses
from services.sensors.world.sun import Daylight
from services.sensors.world.textures import sky_clouds


@dataclass(frozen=True, slots=True)
class _Lit:
    """The light maps, what the bands see of each endmember in sun and under the sky, and the sky's own light.

    ``evenly`` (N, 12) float32 is what the three bands receive of each of a polygon's four lanes at its first sample
    of light.
    """

    maps: LightMaps
    sun: Array
    sky: Array
    backdrop: Array
    evenly: Floats


def white_light(light: Daylight, bands: Array) -> tuple[Array, Array]:
    """What bands of sensitivities (3, L) see of a white surface in the sun, and under the sky: (3,), (3,)."""
    sun = illuminant(light.sun_temperature, light.sun_irradiance)
    sky = illuminant(light.sky_temperature, light.sky_irradiance)
    ideal = np.ones(REFLECTANCES.shape[-1])
    return responses(ideal, sun, bands), responses(ideal, sky, bands)


class Renderer:
    """Draws a scene for a stereo camera under a light that can be changed."""

    def __init__(
        self, settings: WorldSettings, geometry: Geometry, scene: Scene, light: Daylight, maps: LightMaps
    ) -> None:
        self._camera, self._samples = settings.rig, settings.imaging.samples
        self._geometry, self._textures = geometry, scene.textures
        self._bands = band_sensitivities(settings.bands)
        self._clouds = sky_clouds(np.random.default_rng(settings.scene.seed), settings.clouds)
        c = settings.rig
        self._intrinsics = np.array([c.fx, c.fy, c.cx, c.cy])
        self._screen = np.zeros((len(geometry.corners), 16), np.float32)
        self._scratch = np.zeros((8, 8))
        self._lit = self._lighting(light, maps)

    def set_light(self, light: Daylight, maps: LightMaps | None) -> None:
        """Change the light; without new ``maps`` the old shadows stay.

        The two are swapped in by one assignment, so that an image in the making keeps its own.
        """
        self._lit = self._lighting(light, maps or self._lit.maps)

    def _lighting(self, light: Daylight, maps: LightMaps) -> _Lit:
        """What the bands see in a light with its maps."""
        sun = illuminant(light.sun_temperature, light.sun_irradiance)
        sky = illuminant(light.sky_temperature, light.sky_irradiance)
        in_sun, in_sky = (responses(REFLECTANCES, spectrum, self._bands) for spectrum in (sun, sky))
        return _Lit(maps, in_sun, in_sky, self._backdrop(light), self._evenly(maps, in_sun, in_sky))

    def _evenly(self, maps: LightMaps, in_sun: Array, in_sky: Array) -> Floats:
        """Per polygon and lane what the bands receive: it depends on no view, so it is kept."""
        g = self._geometry
        first = g.indices[:, CHART_START].clip(max=len(maps.charts) - 1)
        sample = maps.charts[first]
        sunlit, skylit = ((s / 65535.0)[:, None, None] for s in (sample & 0xFFFF, sample >> 16))
        material = g.indices[:, MATERIAL]
        colours = g.weights[..., None] * (sunlit * in_sun[material] + skylit * in_sky[material])
        return np.ascontiguousarray(colours.reshape(-1, 12).astype(np.float32))

    @property
    def baked_for(self) -> Array:
        """Direction (3,) of the sun that the present shadows are for."""
        return self._lit.maps.sun

    def _backdrop(self, light: Daylight) -> Array:
        """The sky's own light (3, 3): at the horizon, at the zenith, of clouds."""
        sun, sky = white_light(light, self._bands)
        low = float(np.clip(np.sin(light.elevation), 0.0, 1.0))
        horizon = 1.4 * sky + (0.05 + 0.04 * low) * sun
        return np.array([horizon, 0.8 * sky, 1.2 * sky + (0.12 + 0.25 * low) * sun])

    def stereo(self, T_world_vehicle: Array) -> tuple[Floats, Floats]:
        """The light (H, W, 3) in the left and the right camera of a vehicle at a pose (4, 4)."""
        T_world_left = T_world_vehicle @ self._camera.T_vehicle_camera
        right = T_world_left[:3, 3] + self._camera.baseline * T_world_left[:3, 0]
        rotation = np.ascontiguousarray(T_world_left[:3, :3])
        return self._light_at(rotation, T_world_left[:3, 3].copy()), self._light_at(rotation, right)

    def left(self, T_world_vehicle: Array) -> Floats:
        """The light (H, W, 3) in the left camera alone."""
        T_world_left = T_world_vehicle @ self._camera.T_vehicle_camera
        return self._light_at(np.ascontiguousarray(T_world_left[:3, :3]), T_world_left[:3, 3].copy())

    def _light_at(self, rotation: Array, centre: Array) -> Floats:
        """One image's light, for a camera of a rotation (3, 3) and an optical centre (3,) in the world."""
        _, polygon = self._visible(rotation, centre, self._samples)
        lit = self._lit
        image = np.empty((self._camera.height, self._camera.width, 3), np.float32)
        g, t = self._geometry, self._textures
        shade(
            polygon, self._screen, self._samples, g.weights, g.indices, lit.evenly, t.texels, t.starts, t.logs,
            lit.maps.ground, lit.maps.charts, lit.sun, lit.sky, lit.backdrop, self._clouds,
            rotation, self._intrinsics,
            np.zeros((2, SCRATCH), np.int32), np.zeros((WORDS, SCRATCH), np.uint32),
            np.empty((3, SCRATCH), np.float32), image,
        )  # fmt: skip
        return image

    def _visible(self, rotation: Array, centre: Array, samples: int) -> tuple[Floats, NDArray[np.int32]]:
        """Inverse depth and polygon of every sample."""
        shape = (self._camera.height * samples, self._camera.width * samples)
        inverse_depth, polygon = np.empty(shape, np.float32), np.empty(shape, np.int32)
        g = self._geometry
        rasterise(
            g.corners, g.sizes, g.normals, g.two_sided, g.group_starts, g.group_spheres, g.maps,
            np.ascontiguousarray(rotation.T), centre, self._intrinsics, samples, inverse_depth, polygon,
            self._screen, self._scratch,
        )  # fmt: skip
        return inverse_depth, polygon

    def depth(self, T_world_vehicle: Array) -> Floats:
        """Depth (H, W), metres, at the left image's pixel centres, infinite for the sky."""
        T = T_world_vehicle @ self._camera.T_vehicle_camera
        inverse_depth, _ = self._visible(np.ascontiguousarray(T[:3, :3]), T[:3, 3].copy(), 1)
        with np.errstate(divide="ignore"):
            return np.asarray(1.0 / inverse_depth)
