"""How long the synthetic world takes: images, a new position of the sun, scans; beside embree's rays."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from datetime import timedelta

import numpy as np

from bench import table
from common.geometry import Array
from services.sensors.world import World, WorldSettings

_PLACES = 24


def user_milliseconds(work: Callable[[], object]) -> float:
    """CPU milliseconds of a call."""
    start = time.process_time()
    work()
    return 1e3 * (time.process_time() - start)


def pixel_rays(world: World) -> tuple[Array, Array]:
    """Origins and unit directions (N, 3) in the world of the rays through every pixel of both cameras."""
    c = world.camera
    u, v = np.meshgrid(np.arange(c.width), np.arange(c.height))
    rays = np.stack([(u - c.cx) / c.fx, (v - c.cy) / c.fy, np.ones(u.shape)], axis=-1).reshape(-1, 3)
    T = world.T_world_vehicle @ c.T_vehicle_camera
    directions = np.tile(rays / np.linalg.norm(rays, axis=-1, keepdims=True) @ T[:3, :3].T, (2, 1))
    eyes = T[:3, 3] + np.outer([0.0, c.baseline], T[:3, 0])
    return np.repeat(eyes, len(rays), axis=0), directions


def around_the_route(world: World, work: Callable[[], object]) -> tuple[float, float]:
    """Median and greatest CPU milliseconds of ``work`` at places around the demo's route."""
    route = world.scene.demo_route()
    spent = []
    for k in np.linspace(0, len(route) - 1, _PLACES).astype(int):
        world.place(*route[k])
        spent.append(user_milliseconds(work))
    return float(np.median(spent)), max(spent)


def _row(name: str, median: float, most: float) -> list[object]:
    return [name, median, most, 1e3 / median, 1e3 / most]


def main() -> None:
    """Print the table."""
    rows: list[list[object]] = []
    for samples in (1, 2):
        settings = WorldSettings()
        world = World(replace(settings, imaging=replace(settings.imaging, samples=samples)))
        world.warm_up()
        each = f"{samples}x{samples} samples a pixel"
        rows.append(_row(f"stereo pair, {each}", *around_the_route(world, world.render)))
        rows.append(_row(f"one image, {each}", *around_the_route(world, world.render_left)))
    # The peer only finds what each pixel shows; it neither shades nor exposes.
    rows.append(_row("embree: first hits of a pair", *around_the_route(world, lambda: _cast(world))))
    for beams in (32, 64):
        rows.extend(lidar_rows(beams))
    later = world.settings.time + timedelta(hours=2)
    bake = user_milliseconds(lambda: world.set_time(later))
    rows.append(_row("new shadows", bake, bake))
    c = world.camera
    table.show(
        f"synthetic world: CPU time, images of {c.width}x{c.height}",
        ["what", "median ms", "most ms", "a second", "at worst"],
        rows,
        f"at {_PLACES} places of the demo's route; embree casts one ray a pixel, or a beam, and shades nothing",
    )


def lidar_rows(beams: int) -> list[list[object]]:
    """The rows of a lidar with a number of beams."""
    settings = WorldSettings()
    world = World(replace(settings, lidar=replace(settings.lidar, beams=beams)))
    world.warm_up(cameras=False)
    azimuth, elevation = np.meshgrid(world.lidar.azimuths, world.lidar.elevations, indexing="ij")
    flat = np.cos(elevation)
    rays = np.stack([np.cos(azimuth) * flat, np.sin(azimuth) * flat, np.sin(elevation)], axis=-1).reshape(-1, 3)

    def cast() -> object:
        T = world.T_world_vehicle @ world.lidar.T_vehicle_lidar
        return world.cast_rays(np.broadcast_to(T[:3, 3], rays.shape), rays @ T[:3, :3].T)

    name = f"{beams}x{len(world.lidar.azimuths)}"
    return [
        _row(f"lidar scan, {name}", *around_the_route(world, world.scan)),
        _row(f"embree: first hits of {name} rays", *around_the_route(world, cast)),
    ]


def _cast(world: World) -> object:
    """What both cameras see, by ray casting."""
    return world.cast_rays(*pixel_rays(world))


if __name__ == "__main__":
    main()
