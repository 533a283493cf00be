"""Whether covariances are honest: NEES in the synthetic world beside the band in which it belongs."""

from __future__ import annotations

from dataclasses import replace
from datetime import UTC, datetime

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from bench import table
from services.estimator.offline import Route, process
from services.estimator.offline.consistency import of_edges, of_localization, of_odometry
from services.estimator.settings import Settings
from services.sensors.world import World, WorldSettings
from services.sensors.world.traversal import DrivingSettings, Traversal

_DIMENSION = 6
_HOURS = (9, 12)


def _row(name: str, values: NDArray[np.float64]) -> list[object]:
    count = len(values)
    low, high = chi2.ppf([0.025, 0.975], _DIMENSION * count) / count
    lowest, highest = chi2.ppf([0.025, 0.975], _DIMENSION)
    inside = 100.0 * float(((values > lowest) & (values < highest)).mean())
    return [name, count, float(values.mean()), f"{low:.2f} to {high:.2f}", inside]


def main() -> None:
    """Prints mean NEES with its band, and the part of single samples in theirs."""
    cv2.setNumThreads(1)
    settings, world, drives = Settings(), WorldSettings(clouds=0.0), []
    for wind, hour in enumerate(_HOURS):
        here = World(replace(world, scene=replace(world.scene, wind=wind)))
        time = datetime(2026, 6, 21, hour, tzinfo=UTC)
        drives.append(list(process(Traversal.of(here, time, DrivingSettings(spacing=0.15), wind), settings)))
    route = Route(world.camera, settings)
    route.teach(drives[0])
    odometry = np.concatenate([of_odometry(drive, world.camera.T_vehicle_camera) for drive in drives])
    rows = [
        _row("odometry since the keyframe", odometry),
        _row("odometry between vertices", of_edges(route)),
        _row(f"localization at {_HOURS[1]}:00, taught at {_HOURS[0]}:00", of_localization(route, drives[1])),
    ]
    table.show(
        "consistency: NEES of poses in the synthetic world",
        ["estimate", "samples", "mean NEES", "its 95 % band", "singles inside 95 %"],
        rows,
        note="6 for errors as large as the covariance says; more: too confident, less: too modest",
    )


if __name__ == "__main__":
    main()
