"""Localization along a route with few and with many experiences in the map: the work of a frame must stay bounded."""

from __future__ import annotations

import itertools
from datetime import UTC, datetime
from time import perf_counter

import cv2
import numpy as np

from bench import table
from services.estimator.experiences import RouteExperiences
from services.estimator.offline import Processed, Route, process
from services.estimator.settings import Settings
from services.sensors.world import World, WorldSettings
from services.sensors.world.traversal import DrivingSettings, Traversal

_FRAMES = 40
_COUNTS = (0, 1, 3, 10, 50)


def _drive(world: World, hour: int, seed: int, settings: Settings) -> list[Processed]:
    traversal = Traversal.of(world, datetime(2026, 6, 21, hour, tzinfo=UTC), DrivingSettings(), seed)
    return list(itertools.islice(process(traversal, settings), _FRAMES))


def main() -> None:
    """Prints milliseconds of a localization by the number of recorded experiences."""
    cv2.setNumThreads(1)
    settings, world = Settings(), World(WorldSettings(clouds=0.0))
    taught, repeated = (_drive(world, hour, seed, settings) for seed, hour in enumerate((7, 12)))
    route = Route(world.camera, settings)
    route.teach(taught)
    rows: list[list[object]] = []
    for count in range(max(_COUNTS) + 1):
        if count in _COUNTS:
            run = route.repeat(repeated)
            p50, p99 = np.percentile(run.localizing_milliseconds[1:], [50, 99])
            graph, vertices = route.memory.graph, route.memory.route
            begin = perf_counter()
            RouteExperiences(graph, vertices, graph.poses_along(vertices), settings.experiences)
            laying = 1e3 * (perf_counter() - begin)
            rows.append([count, len(graph), float(np.median(run.inliers)), float(p50), float(p99), laying])
        route.repeat(repeated, record=True)
    table.show(
        f"experiences: {_FRAMES} frames of 640x400 localized in both streams, one thread",
        ["experiences", "vertices", "inliers", "a frame, p50 ms", "p99 ms", "laying them out once, ms"],
        rows,
        note=f"at most {settings.experiences.most} are joined at a time; laying out happens beside the frames",
    )


if __name__ == "__main__":
    main()
