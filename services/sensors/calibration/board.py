"""The ChArUco board: a chessboard whose white squares hold markers, so that every corner is known by its number."""

from __future__ import annotations

import struct
import zlib
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from services.sensors.calibration.errors import CalibrationError

Array = NDArray[np.float64]
Image = NDArray[np.uint8]

FAMILIES = ("4X4", "5X5", "6X6", "7X7")
_SIZES = (50, 100, 250, 1000)
DICTIONARIES = (
    *(f"{family}_{size}" for family in FAMILIES for size in _SIZES),
    "ARUCO_ORIGINAL",
    "ARUCO_MIP_36h12",
    "APRILTAG_16h5",
    "APRILTAG_25h9",
    "APRILTAG_36h10",
    "APRILTAG_36h11",
)
"""OpenCV's predefined dictionaries, without their ``DICT_``. The smaller ones of a family begin the larger ones."""

_PRINT_PIXELS_PER_METRE = 11811
"""300 dots an inch."""
_CAPTION = 0.14
"""Height of the letters below a drawn board, squares."""


@dataclass(frozen=True, slots=True)
class Board:
    """A ChArUco board.

    Attributes:
        columns, rows: squares in x and y.
        square, marker: their sides, metres.
        dictionary: of its markers, one of :data:`DICTIONARIES`.
        legacy: whether the first square is white although the number of rows is even, as OpenCV drew it before 4.6.
    """

    columns: int
    rows: int
    square: float
    marker: float
    dictionary: str = "5X5_100"
    legacy: bool = False

    def __post_init__(self) -> None:
        """Refuses a board that cannot be.

        Raises:
            CalibrationError: too few or too many squares, sides that do not fit, or an unknown dictionary.
        """
        if not (3 <= self.columns <= 40 and 3 <= self.rows <= 40):
            raise CalibrationError(
                f"a board of {self.columns}x{self.rows} squares is none: give 3 to 40 squares on either side"
            )
        if not 0.0 < self.marker < self.square < 10.0:
            raise CalibrationError(
                f"markers of {self.marker:g} m do not fit into squares of {self.square:g} m: "
                "give both sides in metres, the marker's being the smaller one"
            )
        if self.dictionary not in DICTIONARIES:
            raise CalibrationError(f"there is no dictionary '{self.dictionary}': choose of {', '.join(DICTIONARIES)}")
        if self.columns * self.rows // 2 > dictionary_size(self.dictionary):
            raise CalibrationError(
                f"a board of {self.columns}x{self.rows} squares has {self.columns * self.rows // 2} markers, the "
                f"dictionary {self.dictionary} only {dictionary_size(self.dictionary)}: choose a larger one"
            )

    def __str__(self) -> str:
        """As a person would name it."""
        sides = f"squares of {1e3 * self.square:g} mm, markers of {1e3 * self.marker:g} mm"
        return f"{self.columns}x{self.rows} {self.dictionary}{' (legacy)' if self.legacy else ''}, {sides}"

    @property
    def corners(self) -> Array:
        """The chessboard's inner corners (N, 3) in the board's frame (x right, y down, z into it), metres."""
        return np.asarray(self.opencv().getChessboardCorners(), dtype=np.float64)

    def opencv(self) -> Any:  # noqa: ANN401, OpenCV's classes have no types
        """OpenCV's board."""
        made = cv2.aruco.CharucoBoard((self.columns, self.rows), self.square, self.marker, predefined(self.dictionary))
        made.setLegacyPattern(self.legacy)
        return made

    def draw(self, pixels: int, margin: int) -> Image:
        """The board (H, W) with ``pixels`` a square and a white margin of ``margin`` pixels around it."""
        drawn = self.opencv().generateImage((self.columns * pixels, self.rows * pixels), marginSize=0, borderBits=1)
        return np.asarray(np.pad(drawn, margin, constant_values=255), dtype=np.uint8)


def predefined(dictionary: str) -> Any:  # noqa: ANN401, as above
    """OpenCV's dictionary of a name."""
    return cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, f"DICT_{dictionary}"))


def dictionary_size(dictionary: str) -> int:
    """How many markers a dictionary has."""
    return len(predefined(dictionary).bytesList)


def printable(board: Board) -> bytes:
    """A PNG file of the board at its true size when it is printed at 100 %, with its measures below it."""
    pixels = max(40, round(board.square * _PRINT_PIXELS_PER_METRE))
    image = board.draw(pixels, pixels // 2)
    caption = f"{board.columns}x{board.rows} {board.dictionary}, square {1e3 * board.square:g} mm, marker "
    caption += f"{1e3 * board.marker:g} mm: measure the squares"
    height = min(_CAPTION * pixels, 0.9 * image.shape[1] / len(caption))
    baseline = image.shape[0] - pixels // 8
    cv2.putText(image, caption, (pixels // 2, baseline), cv2.FONT_HERSHEY_SIMPLEX, height / 22.0, 0, 1 + pixels // 200)
    encoded = cv2.imencode(".png", image)[1].tobytes()
    return with_resolution(encoded, round(pixels / board.square))


def with_resolution(png: bytes, pixels_per_metre: int) -> bytes:
    """A PNG file with the chunk ``pHYs``, which tells a printer how large it is."""
    body = b"pHYs" + struct.pack(">IIB", pixels_per_metre, pixels_per_metre, 1)
    chunk = struct.pack(">I", 9) + body + struct.pack(">I", zlib.crc32(body))
    header = 8 + 25
    return png[:header] + chunk + png[header:]
