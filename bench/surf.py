"""SURF beside OpenCV's ORB and SIFT: how surely features are found again, and what it costs, in one run.

The images are frames of KITTI 06 and of GRIEF where they are found (``VTR_DATA``, else ``../shared/data``), else a
photograph that ships with matplotlib. All find at most 1000 features an image and match each other's nearest
descriptors. Everything runs on one thread; times are of the processor, so that other work counts little.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable
from dataclasses import replace
from time import process_time
from typing import Any, NamedTuple, Protocol

import cv2
import matplotlib.cbook
import numpy as np
from numpy.typing import NDArray

from bench import recordings, table
from services.estimator.surf import SurfSettings, Window, detect_and_describe, match
from services.estimator.surf.evaluation import Score, score, views

Image = NDArray[np.uint8]
Array = NDArray[np.float64]
Pairs = NDArray[np.int64]
FEATURES = 1000
_ROUNDS = 11


class _Found(NamedTuple):
    """Features of an image: places (N, 2), sizes (N,), and what the matching of their kind needs."""

    places: Array
    sizes: Array
    looks: Any


class _Way(Protocol):
    """A kind of feature."""

    def find(self, image: Image, mask: Image | None) -> _Found:
        """The features of an image."""

    def match(self, a: _Found, b: _Found) -> Pairs:
        """Each other's nearest (M, 2)."""


class _Surf:
    """Ours."""

    def __init__(self, settings: SurfSettings) -> None:
        # Distances are not limited: all three are asked for the same, each other's nearest.
        self.settings = replace(settings, ratio=1.0, max_distance=2.0)

    def find(self, image: Image, mask: Image | None) -> _Found:
        found = detect_and_describe(image, self.settings, mask)
        return _Found(found.points.astype(np.float64), found.scales.astype(np.float64), found)

    def match(self, a: _Found, b: _Found) -> Pairs:
        return match(a.looks, b.looks, self.settings).pairs


class _OpenCv:
    """A detector of OpenCV, with brute-force matching."""

    def __init__(self, detector: cv2.Feature2D, norm: int) -> None:
        self.detector, self.matcher = detector, cv2.BFMatcher(norm, crossCheck=True)

    def find(self, image: Image, mask: Image | None) -> _Found:
        found, looks = self.detector.detectAndCompute(image, mask)
        return _Found(np.array([k.pt for k in found]).reshape(-1, 2), np.array([k.size for k in found]), looks)

    def match(self, a: _Found, b: _Found) -> Pairs:
        found = self.matcher.match(a.looks, b.looks) if len(a.places) and len(b.places) else []
        return np.array([(m.queryIdx, m.trainIdx) for m in found], np.int64).reshape(-1, 2)


def _ways() -> dict[str, _Way]:
    return {
        "SURF, retraverse": _Surf(SurfSettings(max_features=FEATURES)),
        "SURF, retraverse, spread over cells": _Surf(SurfSettings(max_features=FEATURES, cell=40)),
        "ORB, OpenCV": _OpenCv(cv2.ORB.create(FEATURES), cv2.NORM_HAMMING),
        "SIFT, OpenCV": _OpenCv(cv2.SIFT.create(FEATURES), cv2.NORM_L2),
    }


def _images() -> dict[str, list[Image]]:
    """Grey images by the name of their kind."""
    kinds = {"KITTI 06": "kitti06_gray_stereo/left/*.*", "GRIEF": "grief_stromovka_monthly/images/*.webp"}
    found = {name: sorted(recordings.folder().glob(pattern)) for name, pattern in kinds.items()}
    chosen = {name: files[:: max(len(files) // 4, 1)][:4] for name, files in found.items() if files}
    if chosen:
        return {name: [_grey(str(file)) for file in files] for name, files in chosen.items()}
    return {"a photograph": [_grey(str(matplotlib.cbook.get_sample_data("grace_hopper.jpg", asfileobj=False)))]}


def _grey(file: str) -> Image:
    image = cv2.imread(file, cv2.IMREAD_GRAYSCALE)
    assert image is not None, file
    return np.ascontiguousarray(image[:, :1024], np.uint8)


def _quality(kind: str, images: list[Image]) -> None:
    scores: dict[str, dict[str, list[Score]]] = defaultdict(lambda: defaultdict(list))
    for image in images:
        for name, way in _ways().items():
            first = way.find(image, None)
            for view in views(image):
                second = way.find(view.image, view.mask)
                scores[name][view.name].append(score(first[:2], second[:2], way.match(first, second), view))
    columns = list(next(iter(scores.values())))
    for index, figure in enumerate(Score._fields):
        rows: list[list[object]] = [
            [name, *(100 * float(np.mean([s[index] for s in found[c]])) for c in columns)]
            for name, found in scores.items()
        ]
        note = f"{len(images)} images, {sum(map(len, next(iter(scores.values())).values())) // len(images)} views each"
        table.show(f"{figure} on {kind}, %", ["features", *columns], rows, note)


def _milliseconds(run: Callable[[], object]) -> float:
    run()
    times = []
    for _ in range(_ROUNDS):
        begin = process_time()
        run()
        times.append(1e3 * (process_time() - begin))
    return float(np.median(times))


def _times(image: Image) -> None:
    settings = SurfSettings(max_features=FEATURES)
    upright = replace(settings, upright=True)
    rows: list[list[object]] = []
    for name, way in _ways().items():
        rows.append(
            [f"{name}: {image.shape[1]}x{image.shape[0]}", _milliseconds(lambda way=way: way.find(image, None))]
        )
    rows.append(["SURF upright", _milliseconds(lambda: detect_and_describe(image, upright))])
    for lines in (64, 128):
        band = np.ascontiguousarray(image[120 : 120 + lines])
        for name, used in (("SURF", settings), ("SURF upright", upright)):
            time = _milliseconds(lambda band=band, used=used: detect_and_describe(band, used, wrap=True))
            rows.append([f"{name}: panorama 1024x{lines}", time])
        for name, way in (("ORB", _ways()["ORB, OpenCV"]), ("SIFT", _ways()["SIFT, OpenCV"])):
            rows.append([f"{name}: 1024x{lines}", _milliseconds(lambda band=band, way=way: way.find(band, None))])
    a, b = detect_and_describe(image, settings), detect_and_describe(np.ascontiguousarray(image[3:, 5:]), settings)
    rows.append(["match all to all, mutual", _milliseconds(lambda: match(a, b))])
    rows.append(
        ["match in windows of 80x40", _milliseconds(lambda: match(a, b, candidates=Window(a.points, (40.0, 20.0))))]
    )
    matcher = cv2.BFMatcher(cv2.NORM_L2, crossCheck=True)
    rows.append(["match the same, cv2.BFMatcher", _milliseconds(lambda: matcher.match(a.descriptors, b.descriptors))])
    table.show(f"at most {FEATURES} features, one thread", ["what", "median ms"], rows)


def main() -> None:
    """Print the tables."""
    cv2.setNumThreads(1)
    images = _images()
    _times(next(iter(images.values()))[0])
    for kind, chosen in images.items():
        _quality(kind, chosen)


if __name__ == "__main__":
    main()
