"""The illumination-invariant stream: what it costs, and what it gives beside a system without it."""

from __future__ import annotations

import tempfile
from pathlib import Path
from time import process_time

import cv2
import numpy as np

from bench import table
from cli.leave_one_out.report import figures
from cli.leave_one_out.results import BASELINE, COMBINED
from cli.leave_one_out.study import Study, evaluate, times_of_day
from common.camera import StereoCamera
from services.estimator.settings import Settings
from services.estimator.stereo.invariance import InvariantTransform
from services.estimator.stereo.settings import InvarianceSettings
from services.sensors.world.traversal import DrivingSettings

_SIZES = ((1241, 376), (640, 400))
_ROUNDS = 50


def _cost() -> None:
    rows: list[list[object]] = []
    for width, height in _SIZES:
        camera = StereoCamera(width, height, 700.0, 700.0, width / 2, height / 2, 0.5)
        image = np.random.default_rng(0).integers(0, 255, (height, width, 3), dtype=np.uint8)
        ways = {
            "retraverse": InvariantTransform(camera, InvarianceSettings()),
            "numpy, without smoothing": lambda x: (
                np.log(x[..., 1] + 1.0) - 0.48 * np.log(x[..., 2] + 1.0) - 0.5065 * np.log(x[..., 0] + 1.0)
            ),
        }
        for way, transform in ways.items():
            transform(image)
            times = []
            for _ in range(_ROUNDS):
                begin = process_time()
                transform(image)
                times.append(1e3 * (process_time() - begin))
            rows.append([f"{width}x{height}", way, float(np.median(times))])
    table.show("invariance: the transform of one image, one thread", ["image", "way", "median ms"], rows)


def _gain() -> None:
    study = Study(times_of_day("06:30", "16:00", 3), Settings(), DrivingSettings(length=24.0), seed=1)
    with tempfile.TemporaryDirectory() as folder:
        found = figures(evaluate(study, Path(folder), 2, lambda _: None))
    rows: list[list[object]] = [
        [drive["time"][11:16], *(100 * drive["coverage"][system] for system in (BASELINE, COMBINED))]
        for drive in found["drives"]
    ]
    columns = ["repeated at", "plain stream alone, %", "both streams, %"]
    table.show("invariance: coverage on what was taught at two other times of day, 24 m, wind", columns, rows)


def main() -> None:
    """Prints both tables."""
    cv2.setNumThreads(1)
    _cost()
    _gain()


if __name__ == "__main__":
    main()
