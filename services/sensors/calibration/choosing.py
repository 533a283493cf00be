"""Which of the pairs that cameras deliver are kept for a calibration: sharp ones, of a still board, in a new pose."""

from __future__ import annotations

from services.sensors.calibration.board import Board, Image
from services.sensors.calibration.detection import Detection, Detector
from services.sensors.calibration.errors import CalibrationError
from services.sensors.calibration.layout import identify
from services.sensors.calibration.views import View, displacement

STILL = 0.004
"""A board whose corners move by less than this part of the image's width from one pair to the next is held still."""
NEW_POSE = 0.06
"""A board whose corners are further than this part of the width from those of every kept view is in a new pose."""

_DOUBTS = 5
"""One pair of a board that is waved about may look like another board; so many are one."""


class PoseChooser:
    """Looks at one pair after the other, and says of each whether to keep it, or what the person should do."""

    def __init__(self, board: Board, *, any_dictionary: bool = False) -> None:
        self._named, self._any_dictionary = board, any_dictionary
        self._detector: Detector | None = None
        self._doubts = 0
        self._last = Detection(reason="there was none before")
        self.kept: list[View] = []

    def consider(self, left: Image, right: Image) -> str:
        """Why a pair of grey images is not kept, as an instruction; empty where it is kept.

        Raises:
            CalibrationError: the board is another one than was named.
        """
        detector = self._detector or self._find_out(left, right)
        if detector is None:
            return "show the board to both cameras"
        view = View(f"{len(self.kept):03d}", detector.detect(left), detector.detect(right))
        last, self._last = self._last, view.left
        width = left.shape[1]
        if view.reason:
            return view.reason
        if last.reason or displacement(last, view.left) > STILL * width:
            return "hold the board still"
        if any(displacement(kept.left, view.left) < NEW_POSE * width for kept in self.kept):
            return "move or tilt the board"
        self.kept.append(view)
        return ""

    def _find_out(self, left: Image, right: Image) -> Detector | None:
        """A detector of the board, once a pair shows enough of it to tell which it is."""
        try:
            board = identify([left, right], self._named, any_dictionary=self._any_dictionary)
        except CalibrationError:
            self._doubts += 1
            if self._doubts >= _DOUBTS:
                raise
            return None
        detector = Detector(board)
        if detector.detect(left).reason:
            return None
        self._detector = detector
        return detector
