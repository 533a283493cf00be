"""Calibration of a stereo pair beside OpenCV's own, and what rectification costs a frame."""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial

import cv2
import numpy as np

from bench import table
from services.sensors.calibration.board import Image
from services.sensors.calibration.calibrate import Pair, calibrate
from services.sensors.calibration.detection import Detector
from services.sensors.calibration.rectify import Rectifier
from services.sensors.calibration.rig import Lens, StereoRig
from services.sensors.calibration.simulation import BOARD, BoardRenderer, simulated_rig

SIZE = (640, 400)
_LOOKS: dict[str, dict[str, float]] = {
    "blur 0.7 px, noise 2 levels": {},
    "noise 6 levels": {"noise": 6.0},
    "blur 1.1 px": {"blur": 1.1},
}
_SETS, _PAIRS = 8, 20
Way = Callable[[list[Pair]], tuple[StereoRig, float, float]]
"""From pairs to the rig, the reprojection error, and the left focal length's relative standard deviation, or NaN."""
_FRAMES = 200


def main() -> None:
    """Print both tables."""
    cv2.setNumThreads(1)
    truth = simulated_rig(SIZE)
    renderer = BoardRenderer(truth)
    sets = {name: [renderer.pairs(_PAIRS, seed, **look) for seed in range(_SETS)] for name, look in _LOOKS.items()}
    first = next(iter(sets.values()))
    sets["3 pairs of two moments"] = [[_spoil(pair, k) for k, pair in enumerate(pairs)] for pairs in first]
    table.show(
        f"calibration from {_PAIRS} pairs of {SIZE[0]}x{SIZE[1]}, {_SETS} sets",
        ["set", "way", "focal %", "baseline %", "error px", "CPU s", "sigma %", "focal / sigma"],
        [_row(name, way, work, made, truth) for name, made in sets.items() for way, work in _WAYS.items()],
        "focal lengths and baseline against the rendered truth, the worst of all sets; sigma is what ours says of the "
        "focal length, then its true error in units of it (RMS). OpenCV: calibrateCamera, then stereoCalibrate",
    )
    _show_rectification()


def _ours(pairs: list[Pair]) -> tuple[StereoRig, float, float]:
    found = calibrate(pairs, BOARD)
    return found.found.solution.rig, found.quality.rms, found.quality.focal_sigma[0]


def _opencv(pairs: list[Pair]) -> tuple[StereoRig, float, float]:
    """As a tutorial does it: ``calibrateCamera`` for each camera, then ``stereoCalibrate`` with fixed intrinsics."""
    detector, size = Detector(BOARD), SIZE
    seen = [(detector.detect(left), detector.detect(right)) for _, left, right in pairs]
    objects, corners, lenses = BOARD.corners.astype(np.float32), [], []
    for side in range(2):
        views = [s[side] for s in seen if not s[side].reason]
        _, K, d, *_ = cv2.calibrateCamera(
            [objects[v.ids] for v in views], [v.points.astype(np.float32) for v in views], size, np.eye(3), np.zeros(5)
        )
        lenses.append((K, d))
    for left, right in seen:
        if left.reason or right.reason:
            continue
        ids, a, b = np.intersect1d(left.ids, right.ids, return_indices=True)
        if len(ids) >= 8:
            corners.append((objects[ids], left.points[a].astype(np.float32), right.points[b].astype(np.float32)))
    rms, K1, d1, K2, d2, R, T, *_ = cv2.stereoCalibrate(
        *map(list, zip(*corners, strict=True)), *lenses[0], *lenses[1], size, np.eye(3), np.zeros((3, 1)),
        flags=cv2.CALIB_FIX_INTRINSIC,
    )  # fmt: skip
    left, right = Lens.of(K1, d1), Lens.of(K2, d2)
    return StereoRig(*size, left, right, R, T.ravel()), float(rms), float("nan")


_WAYS = {"ours": _ours, "OpenCV": _opencv}


def _spoil(pair: Pair, k: int) -> Pair:
    """Every seventh pair with its right image of another moment: the board is 4 pixels further down."""
    name, left, right = pair
    return (name, left, np.roll(right, 4, axis=0)) if k % 7 == 3 else pair


def _row(name: str, way: str, work: Way, sets: list[list[Pair]], truth: StereoRig) -> list[object]:
    focal, baseline, rms, sigmas = [], [], [], []
    start = time.process_time()
    for pairs in sets:
        found, error, sigma = work(pairs)
        focal.append((found.left.fx / truth.left.fx - 1.0, found.right.fx / truth.right.fx - 1.0))
        baseline.append(found.baseline / truth.baseline - 1.0)
        rms.append(error)
        sigmas.append(sigma)
    spent = (time.process_time() - start) / len(sets)
    left = np.array(focal)[:, 0]
    ratio = float(np.sqrt(np.mean((left / np.array(sigmas)) ** 2)))
    sigma = float(100 * np.sqrt(np.mean(np.square(sigmas))))
    known: list[object] = ["", ""] if np.isnan(ratio) else [sigma, ratio]
    most = float(100 * np.abs(focal).max()), float(100 * np.abs(baseline).max())
    return [name, way, *most, float(np.mean(rms)), spent, *known]


def _show_rectification() -> None:
    rows: list[list[object]] = []
    for size in (SIZE, (1280, 720)):
        made = simulated_rig(size)
        rectifier, rng = Rectifier.of(made), np.random.default_rng(0)
        for channels, kind in ((1, "grey"), (3, "colour")):
            shape = (size[1], size[0], 3)[: 2 if channels == 1 else 3]
            left, right = (rng.integers(0, 255, shape, dtype=np.uint8) for _ in range(2))
            ours = _milliseconds(partial(rectifier.rectify, left, right))
            anew = _milliseconds(partial(_undistort, made, left, right))
            rows.append([f"{size[0]}x{size[1]} {kind}", ours, anew])
    table.show(
        "rectification of a pair, CPU ms",
        ["images", "maps made once", "cv2.undistort, which makes them anew"],
        rows,
        "cv2.undistort does not rectify",
    )


def _undistort(made: StereoRig, left: Image, right: Image) -> None:
    for lens, image in ((made.left, left), (made.right, right)):
        cv2.undistort(image, lens.matrix, lens.distortion)


def _milliseconds(work: Callable[[], object]) -> float:
    work()
    start = time.process_time()
    for _ in range(_FRAMES):
        work()
    return 1e3 * (time.process_time() - start) / _FRAMES


if __name__ == "__main__":
    main()
