"""The board's corners in one image, and how sharp they are."""

from __future__ import annotations

from dataclasses import dataclass, field

import cv2
import numpy as np
from numpy.typing import NDArray

from services.sensors.calibration.board import Board

Array = NDArray[np.float64]
Image = NDArray[np.uint8]
Ids = NDArray[np.int64]

MAX_BLUR_PX = 2.0
"""Standard deviation of an edge's spread, pixels, above which an image counts as blurred; a sharp one has 0.5 to 1."""
MIN_CORNERS = 6
"""Fewer corners say little of a pose that has six unknowns."""

_LEVELS = (2.0, 98.0)
_SUBPIXEL = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 40, 1e-4)
_STEP_TO_SIGMA = float(np.sqrt(2.0 * np.pi))
_ALONG = np.linspace(0.3, 0.7, 7)
"""Where an edge between two corners is sampled, as parts of its length."""


def _no_ids() -> Ids:
    return np.zeros(0, dtype=np.int64)


def _no_points() -> Array:
    return np.zeros((0, 2))


@dataclass(frozen=True, slots=True)
class Detection:
    """What one image shows of the board.

    Attributes:
        ids: (N,) numbers of the corners; ``points``: (N, 2) where they are, pixels.
        blur: spread of the edges between them, standard deviation in pixels, in the worse of the board's directions.
        markers: (M,) numbers of all markers of the dictionary; ``quads``: (M, 4, 2) their corners, pixels.
        reason: why the image is of no use, empty where it is.
    """

    ids: Ids = field(default_factory=_no_ids)
    points: Array = field(default_factory=_no_points)
    blur: float = 0.0
    markers: Ids = field(default_factory=_no_ids)
    quads: Array = field(default_factory=lambda: np.zeros((0, 4, 2)))
    reason: str = ""

    def __len__(self) -> int:
        return len(self.ids)


class Detector:
    """Finds one board in grey images (H, W), uint8."""

    def __init__(self, board: Board) -> None:
        self.board = board
        made = board.opencv()
        self._detector = cv2.aruco.CharucoDetector(made)
        self._objects = board.corners
        self._neighbours = _neighbours(board)

    def detect(self, image: Image) -> Detection:
        """The corners of the board in a grey or RGB image, or the reason why there are none."""
        grey = as_grey(image)
        points, ids, quads, markers = self._detector.detectBoard(grey)
        if markers is None or len(markers) == 0:
            return Detection(reason=_nothing_found(grey))
        seen = Detection(
            markers=np.asarray(markers, dtype=np.int64).ravel(),
            quads=np.asarray(quads, dtype=np.float64).reshape(-1, 4, 2),
        )
        if ids is None or len(ids) < MIN_CORNERS:
            count = 0 if ids is None else len(ids)
            return _because(seen, f"{count} of the board's corners are found, {MIN_CORNERS} are needed")
        ids = np.asarray(ids, dtype=np.int64).ravel()
        points = self._refined(grey, ids, np.asarray(points, dtype=np.float64).reshape(-1, 2))
        blur = self._blur(grey, ids, points)
        found = Detection(ids, points, blur, seen.markers, seen.quads)
        if self._detector.getBoard().checkCharucoCornersCollinear(ids.astype(np.int32)):
            return _because(found, "the corners that are found lie on one line")
        if blur > MAX_BLUR_PX:
            return _because(found, f"it is blurred: edges are spread over {blur:.1f} pixels")
        return found

    def _refined(self, grey: Image, ids: Ids, points: Array) -> Array:
        """The corners (N, 2), pixels, by the image's gradients in windows that no marker reaches into."""
        around = _spacing(ids, points, self._neighbours)
        free = 0.5 * (1.0 - self.board.marker / self.board.square) * around
        half = int(np.clip(free, 2.0, 9.0))
        start = points.astype(np.float32).reshape(-1, 1, 2).copy()
        refined = cv2.cornerSubPix(grey, start, (half, half), (-1, -1), _SUBPIXEL)
        moved = np.asarray(refined, dtype=np.float64).reshape(-1, 2)
        wild = np.linalg.norm(moved - points, axis=1) > half
        return np.where(wild[:, None], points, moved)

    def _blur(self, grey: Image, ids: Ids, points: Array) -> float:
        """See :attr:`Detection.blur`.

        A step of height C, blurred by a Gaussian of standard deviation s, has the greatest slope
        ``C / (s sqrt(2 pi))``.
        """
        place = np.full(len(self._objects), -1)
        place[ids] = np.arange(len(ids))
        low, high = np.percentile(_board_pixels(grey, points), _LEVELS)
        worst = 0.0
        for pairs in self._neighbours:
            both = place[pairs]
            both = both[(both >= 0).all(axis=1)]
            if len(both) == 0 or high - low < 1.0:
                continue
            slopes = _slopes(grey, points[both[:, 0]], points[both[:, 1]])
            worst = max(worst, float((high - low) / (_STEP_TO_SIGMA * max(float(np.median(slopes)), 1e-6))))
        return worst


def as_grey(image: Image) -> Image:
    """A grey image (H, W) of a grey or RGB one."""
    if image.ndim == 2:
        return image
    return np.asarray(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY), dtype=np.uint8)


def image_blur(grey: Image) -> float:
    """Spread of any image's sharpest edges, standard deviation in pixels, in the worse of columns and rows.

    Infinite without contrast.
    """
    low, high = np.percentile(grey, _LEVELS)
    if high - low < 10.0:
        return float("inf")
    smooth = cv2.GaussianBlur(grey, (3, 3), 0).astype(np.float32)
    differences = np.abs(smooth[:, 2:] - smooth[:, :-2]), np.abs(smooth[2:] - smooth[:-2])
    slope = min(float(np.percentile(difference, 99.8)) / 2.0 for difference in differences)
    return float((high - low) / (_STEP_TO_SIGMA * max(slope, 1e-6)))


def _because(seen: Detection, reason: str) -> Detection:
    return Detection(seen.ids, seen.points, seen.blur, seen.markers, seen.quads, reason)


def _nothing_found(grey: Image) -> str:
    blur = image_blur(grey)
    if not np.isfinite(blur):
        return "it shows nothing: there is no contrast in it"
    if blur > MAX_BLUR_PX:
        return f"it is blurred: edges are spread over {blur:.1f} pixels, and no marker can be read"
    return "no marker of the board's dictionary is found"


def _neighbours(board: Board) -> tuple[Ids, Ids]:
    """Pairs (K, 2) of corners that are beside each other along the rows, and along the columns."""
    grid = np.arange((board.columns - 1) * (board.rows - 1)).reshape(board.rows - 1, board.columns - 1)
    across = np.stack([grid[:, :-1].ravel(), grid[:, 1:].ravel()], axis=1)
    down = np.stack([grid[:-1].ravel(), grid[1:].ravel()], axis=1)
    return across, down


def _spacing(ids: Ids, points: Array, neighbours: tuple[Ids, Ids]) -> float:
    """The least median distance of neighbouring corners, pixels."""
    place = dict(zip(ids.tolist(), points, strict=True))
    found = []
    for pairs in neighbours:
        lengths = [float(np.linalg.norm(place[a] - place[b])) for a, b in pairs.tolist() if a in place and b in place]
        if lengths:
            found.append(float(np.median(lengths)))
    return min(found, default=20.0)


def _board_pixels(grey: Image, points: Array) -> Image:
    """The part of an image around the corners."""
    (left, top), (right, bottom) = points.min(axis=0).astype(int), np.ceil(points.max(axis=0)).astype(int)
    part = grey[max(top, 0) : bottom + 1, max(left, 0) : right + 1]
    return part if part.size else grey


def _slopes(grey: Image, begins: Array, ends: Array) -> Array:
    """Greatest slope across each edge (K,), grey levels a pixel, averaged along its middle, where noise cancels out."""
    along = ends - begins
    lengths = np.linalg.norm(along, axis=1, keepdims=True)
    normal = np.stack([-along[:, 1], along[:, 0]], axis=1) / np.maximum(lengths, 1e-9)
    across = np.arange(-4.0, 4.01, 0.25)
    at = begins[:, None] + _ALONG[None, :, None] * along[:, None]
    where = at[:, :, None] + across[None, None, :, None] * normal[:, None, None]
    u, v = where.reshape(len(begins), -1, 2).transpose(2, 0, 1).astype(np.float32)
    levels = cv2.remap(grey.astype(np.float32), u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    profile = np.asarray(levels, dtype=np.float64).reshape(len(begins), len(_ALONG), len(across)).mean(axis=1)
    return np.asarray(np.abs(profile[:, 4:] - profile[:, :-4]).max(axis=1))
