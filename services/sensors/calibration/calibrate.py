"""The whole way from pairs of images to a calibration that has been judged."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from services.sensors.calibration.board import Board, Image
from services.sensors.calibration.detection import Detector
from services.sensors.calibration.errors import CalibrationError
from services.sensors.calibration.intrinsics import Coefficients
from services.sensors.calibration.layout import identify
from services.sensors.calibration.quality import Quality, judge
from services.sensors.calibration.rectify import Rectifier
from services.sensors.calibration.stereo import StereoSolution, calibrate_stereo
from services.sensors.calibration.views import View, select

Pair = tuple[str, Image, Image]
"""A pair's name, and its left and right image."""


@dataclass(frozen=True, slots=True)
class Calibration:
    """A result that may be used.

    Attributes:
        board: the one that was seen.
        found: the rig and what it was computed from.
        quality: how good it is.
        rectifier: the maps and the rectified camera.
        dropped: reasons by the names of the pairs that were not used, in the order of the set.
    """

    board: Board
    found: StereoSolution
    quality: Quality
    rectifier: Rectifier
    dropped: dict[str, str]


def calibrate(
    pairs: Sequence[Pair],
    board: Board,
    *,
    any_dictionary: bool = False,
    coefficients: Coefficients = 5,
    progress: Callable[[], None] = lambda: None,
) -> Calibration:
    """A stereo pair's calibration from pairs of images, all of one size; ``progress`` is called after each pair.

    Raises:
        CalibrationError: the set is no basis for one; the sentence says why and what to do.
    """
    width, height = _size(pairs)
    board = identify([image for pair in pairs for image in pair[1:]], board, any_dictionary=any_dictionary)
    detector = Detector(board)
    views = []
    for name, left, right in pairs:
        views.append(View(name, detector.detect(left), detector.detect(right)))
        progress()
    kept, dropped = select(views, width)
    found = calibrate_stereo(kept, board.corners, (width, height), coefficients)
    quality = judge(found)
    reasons = {**dropped, **found.dropped}
    dropped = {view.name: reasons[view.name] for view in views if view.name in reasons}
    return Calibration(board, found, quality, Rectifier.of(found.solution.rig), dropped)


def _size(pairs: Sequence[Pair]) -> tuple[int, int]:
    """Width and height of all images.

    Raises:
        CalibrationError: there are none, or they differ.
    """
    if not pairs:
        raise CalibrationError("there are no pairs of images: take some 20 of them")
    height, width = pairs[0][1].shape[:2]
    for name, *images in pairs:
        for side, image in zip(("left", "right"), images, strict=True):
            if image.shape[:2] != (height, width):
                raise CalibrationError(
                    f"the {side} image of pair {name} has {image.shape[1]}x{image.shape[0]} pixels, the first image "
                    f"{width}x{height}: all must be as the cameras deliver them, of one size"
                )
    return width, height
