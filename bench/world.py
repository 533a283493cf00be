"""How long the synthetic world takes: a pair of images, its stages, a new position of the sun, rays."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from datetime import timedelta

import numpy as np

from services.sensors.world import World, WorldSettings

_PLACES = 24


def user_seconds(work: Callable[[], object]) -> float:
    """User CPU seconds of a call."""
    start = time.process_time()
    work()
    return time.process_time() - start


def pair_milliseconds(world: World) -> tuple[float, float]:
    """Median and greatest user CPU time of a stereo pair around the demo's route."""
    route = world.scene.demo_route()
    world.warm_up()
    spent = []
    for k in np.linspace(0, len(route) - 1, _PLACES).astype(int):
        world.place(*route[k])
        spent.append(1e3 * user_seconds(world.render))
    return float(np.median(spent)), max(spent)


def main() -> None:
    """Print the table."""
    print(f"{'what':44}{'median':>10}{'most':>10}")
    for samples in (1, 2):
        settings = WorldSettings()
        world = World(replace(settings, imaging=replace(settings.imaging, samples=samples)))
        median, most = pair_milliseconds(world)
        print(f"{f'stereo pair 640x400, {samples}x{samples} samples, ms':44}{median:10.1f}{most:10.1f}")
        print(f"{'  pairs a second on one core':44}{1e3 / median:10.1f}{1e3 / most:10.1f}")
    later = world.settings.time + timedelta(hours=2)
    print(f"{'new shadows, s':44}{user_seconds(lambda: world.set_time(later)):10.2f}")
    angle = np.linspace(0.0, 2.0 * np.pi, 32768)
    directions = np.stack([np.cos(angle), np.sin(angle), np.full_like(angle, -0.05)], axis=-1) / np.hypot(1.0, 0.05)
    origins = np.broadcast_to(world.T_world_vehicle[:3, 3] + [0.0, 0.0, 1.0], directions.shape)
    print(f"{'32768 rays, ms':44}{1e3 * user_seconds(lambda: world.cast_rays(origins, directions)):10.1f}")


if __name__ == "__main__":
    main()
