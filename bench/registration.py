"""Horizontal shift between images of one place over a year: ours beside votes of ORB, SIFT and BRIEF, in one run.

The images are GRIEF's park (five places, twelve sessions, one a month), all pairs of sessions of one place, and a
fixed webcam by day and by night, whose images are cut so that the shift is known. The stored image's representation is
at hand, the live one's is made for the pair; decoding does not count. One thread; times are the processor's.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from time import process_time
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from bench import recordings
from bench.table import show
from common.registration import Registrar
from services.estimator.stereo import brief, fast
from services.sensors.recordings.images import read_image

Image = NDArray[np.uint8]
Errors = NDArray[np.float64]

PLACES, SESSIONS = range(1, 6), range(1, 13)
SNOW, LEAVES = (2, 3, 4, 5), (1, 7, 8, 9, 10, 11, 12)
"""Sessions of the park with snow on the ground, and with leaves on the trees."""

_WEBCAM_PAIRS = 200
_FEATURES = 2000
_LEVEL = 80.0
"""Largest vertical distance of two matched features, pixels."""
_BIN = 10.0
"""Standard deviation of a vote, pixels. Of the number of features, this and the level, the best for BRIEF."""


@dataclass(frozen=True)
class Way:
    """A way to find a shift: what it makes of an image, and of two of those."""

    name: str
    describe: Callable[[Image], Any]
    shift: Callable[[Any, Any], float]


@dataclass(frozen=True)
class Pair:
    """Two images by their keys, and how much further right the scene lies in the live one, pixels."""

    live: object
    stored: object
    shift: float


def _votes(norm: int) -> Callable[[Any, Any], float]:
    """The shift for which most cross-checked matches of features vote."""
    matcher = cv2.BFMatcher(norm, crossCheck=True)

    def shift(live: Any, stored: Any) -> float:  # noqa: ANN401, as a way has it
        if len(live[0]) == 0 or len(stored[0]) == 0:
            return 0.0
        matches = matcher.match(live[1], stored[1])
        moved = live[0][[m.queryIdx for m in matches]] - stored[0][[m.trainIdx for m in matches]]
        votes = moved[np.abs(moved[:, 1]) < _LEVEL, 0]
        if len(votes) == 0:
            return 0.0
        strength = np.exp(-0.5 * ((votes[:, None] - votes) / _BIN) ** 2)
        weights = strength[strength.sum(axis=1).argmax()]
        return float((weights * votes).sum() / weights.sum())

    return shift


def _grey(image: Image) -> Image:
    return image if image.ndim == 2 else np.asarray(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY), dtype=np.uint8)


def _by_opencv(detector: Any) -> Callable[[Image], Any]:  # noqa: ANN401, OpenCV's classes have no types
    def describe(image: Image) -> tuple[Errors, Any]:
        found, descriptors = detector.detectAndCompute(_grey(image), None)
        return np.array([feature.pt for feature in found]).reshape(-1, 2), descriptors

    return describe


def _by_brief(image: Image) -> tuple[Errors, Any]:
    grey = _grey(image)
    places = fast.detect(grey, 10, cell=32, limit=_FEATURES)
    smooth = np.asarray(cv2.GaussianBlur(grey, (0, 0), 2.0), dtype=np.uint8)
    return places.astype(np.float64), brief.describe(smooth, places)


def ways() -> list[Way]:
    """All ways that are compared, ours first."""
    ours = Registrar()
    return [
        Way("gradients, all shifts by FFT", ours.prepare, lambda a, b: ours.register(a, b).shift_px),
        Way("FAST + BRIEF votes", _by_brief, _votes(cv2.NORM_HAMMING)),
        Way("ORB votes", _by_opencv(cv2.ORB.create(_FEATURES)), _votes(cv2.NORM_HAMMING)),
        Way("SIFT votes", _by_opencv(cv2.SIFT.create(_FEATURES)), _votes(cv2.NORM_L2)),
    ]


def park(folder: Path) -> tuple[dict[object, Image], list[Pair]]:
    """Images by (place, session), and all pairs of sessions of a place; the truth's entry [i][j] is ``x_j - x_i``."""
    images, pairs = {}, []
    for place in PLACES:
        truth = np.loadtxt(folder / "ground_truth" / f"location_{place}.txt")
        for session in SESSIONS:
            images[place, session] = read_image(folder / "images" / f"{session:02d}{place:02d}.webp")
        for i, j in itertools.combinations(SESSIONS, 2):
            pairs.append(Pair((place, j), (place, i), float(truth[i - 1, j - 1])))
    return images, pairs


def webcam(folder: Path) -> tuple[dict[object, Image], list[Pair]]:
    """Windows of 400 pixels onto random images of the webcam, at random places, and pairs of two."""
    random = np.random.default_rng(0)
    files = sorted((folder / "images").iterdir())
    images, pairs = {}, []
    for k in range(_WEBCAM_PAIRS):
        left = [int(value) for value in random.integers(0, 112, 2)]
        for side, file in enumerate(random.integers(0, len(files), 2)):
            images[k, side] = np.ascontiguousarray(read_image(files[file])[:, left[side] : left[side] + 400])
        pairs.append(Pair((k, 0), (k, 1), float(left[1] - left[0])))
    return images, pairs


def measure(way: Way, images: dict[object, Image], pairs: Sequence[Pair]) -> tuple[Errors, float]:
    """Errors of all pairs, pixels, and milliseconds a pair, the live image's representation included."""
    first = pairs[0]
    way.shift(way.describe(images[first.live]), way.describe(images[first.stored]))  # compiles what is to be compiled
    begin = process_time()
    described = {key: way.describe(image) for key, image in images.items()}
    describing = (process_time() - begin) / len(images)
    begin = process_time()
    shifts = [way.shift(described[pair.live], described[pair.stored]) for pair in pairs]
    comparing = (process_time() - begin) / len(pairs)
    return np.array(shifts) - [pair.shift for pair in pairs], 1e3 * (describing + comparing)


def figures(errors: Errors) -> list[object]:
    """Percent within 35 and within 10 pixels, and the median of the absolute errors."""
    size = np.abs(errors)
    return [100 * float((size <= 35).mean()), 100 * float((size <= 10).mean()), float(np.median(size))]


def _by_part(pairs: Sequence[Pair], errors: Errors) -> list[list[object]]:
    """Figures of each place, of snow against leaves, and of the two sessions that go worst together."""
    keys: list[Any] = [(pair.live, pair.stored) for pair in pairs]
    sessions = [frozenset((live[1], stored[1])) for live, stored in keys]
    rows: list[list[object]] = [
        [f"place {place}", *figures(errors[[live[0] == place for live, _ in keys]])] for place in PLACES
    ]
    apart = [bool(both & set(SNOW)) and bool(both & set(LEAVES)) for both in sessions]
    rows.append(["snow against leaves", *figures(errors[apart])])
    worst = max(set(sessions), key=lambda both: float(np.abs(errors[[s == both for s in sessions]]).mean()))
    name = " and ".join(map(str, sorted(worst)))
    rows.append([f"worst two sessions, {name}", *figures(errors[[s == worst for s in sessions]])])
    return rows


def main() -> None:
    """Print the figures of all ways on the park and the webcam, and ours by place and season."""
    cv2.setNumThreads(1)
    columns = ["within 35 px, %", "within 10 px, %", "median px"]
    for name, load in (("grief_stromovka_monthly", park), ("webcam_vegas", webcam)):
        folder = recordings.folder() / name
        if not folder.is_dir():
            print(f"registration: {name} is not at hand; set VTR_DATA")
            continue
        images, pairs = load(folder)
        measured = {way.name: measure(way, images, pairs) for way in ways()}
        rows = [[name, *figures(errors), ms] for name, (errors, ms) in measured.items()]
        show(f"horizontal shift: {name}, {len(pairs)} pairs, one thread", ["way", *columns, "ms a pair"], rows)
        if load is park:
            errors = next(iter(measured.values()))[0]
            show("horizontal shift: ours in the park, by part", ["pairs", *columns], _by_part(pairs, errors))


if __name__ == "__main__":
    main()
