"""Whether the images show the board that was named: its dictionary, where its markers lie, and how large they are."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from services.sensors.calibration.board import DICTIONARIES, FAMILIES, Board, dictionary_size, predefined
from services.sensors.calibration.detection import Image, as_grey
from services.sensors.calibration.errors import CalibrationError

Array = NDArray[np.float64]
Ids = NDArray[np.int64]

_SAMPLE = 8
"""Images that are looked at."""
_MIN_MARKERS = 4
_TOLERANCE = 0.35
"""How far a marker may lie from where its neighbour puts it, squares: perspective enters, and blur."""
_AGREEMENT = 0.8
"""Share of the neighbours that lie where a layout puts them, above which the board is that one."""
_RATIO = 0.2
"""Greatest relative difference of the marker's side, in squares, as named and as seen: blur makes markers small."""
_NEIGHBOURS = 2.1
"""Squares up to which two markers are neighbours."""
_LARGEST = 16


@dataclass(frozen=True, slots=True)
class Markers:
    """The markers of one dictionary in one image: their numbers (M,) and corners (M, 4, 2), pixels."""

    ids: Ids
    quads: Array


def identify(images: Sequence[Image], board: Board, *, any_dictionary: bool = False) -> Board:
    """The board that the images show, which is ``board``, with the dictionary and the legacy pattern that fit.

    With ``any_dictionary`` the dictionary is found out. Where no marker can be read at all, ``board`` is returned as it
    is: its detection will say why, image by image.

    Raises:
        CalibrationError: the images show another board, or its measures were named wrongly.
    """
    sample = [as_grey(images[i]) for i in np.unique(np.linspace(0, len(images) - 1, _SAMPLE).astype(int))]
    seen = find_markers(sample, board.dictionary)
    if any_dictionary or not _legible(seen):
        dictionary = _dictionary(sample, board)
        if dictionary is None:
            _check_not_mirrored(sample, seen, board, any_dictionary=any_dictionary)
            return board
        if not any_dictionary:
            raise CalibrationError(
                f"the images show no markers of the dictionary {board.dictionary}, but of {dictionary}: give "
                f"--dictionary {dictionary}, or photograph the right board"
            )
        if _family(dictionary) != _family(board.dictionary):
            board = replace(board, dictionary=dictionary)
        seen = find_markers(sample, board.dictionary)
    _check_not_mirrored(sample, seen, board, any_dictionary=any_dictionary)
    if not _legible(seen):
        return board
    variants = [board, replace(board, legacy=True)] if board.rows % 2 == 0 else [board]
    fitting = max(variants, key=lambda variant: agreement(variant, seen))
    if agreement(fitting, seen) < _AGREEMENT or _has_strangers(fitting, seen):
        raise CalibrationError(_another(board, seen))
    _check_ratio(fitting, seen)
    return fitting


def _check_not_mirrored(
    sample: Sequence[Image], seen: Sequence[Markers], board: Board, *, any_dictionary: bool
) -> None:
    """Looks at the images without markers as in a mirror: some cameras' drivers mirror, and no marker reads both ways.

    Raises:
        CalibrationError: most of them show the board then.
    """
    unread = [image for image, markers in zip(sample, seen, strict=True) if len(markers.ids) < _MIN_MARKERS]
    mirrored = [np.ascontiguousarray(image[:, ::-1]) for image in unread]
    name = (_dictionary(mirrored, board) if any_dictionary else None) or board.dictionary
    legible = sum(len(markers.ids) >= _MIN_MARKERS for markers in find_markers(mirrored, name))
    if legible > len(unread) / 2:
        which = "the images are mirrored" if len(unread) == len(sample) else "one camera's images are mirrored"
        raise CalibrationError(f"{which}: switch that off in the camera's driver, for no rectification undoes it")


def find_markers(images: Sequence[Image], dictionary: str) -> list[Markers]:
    """The markers of a dictionary in each of some grey images."""
    detector = cv2.aruco.ArucoDetector(predefined(dictionary))
    found = []
    for image in images:
        quads, ids, _ = detector.detectMarkers(image)
        numbers = np.zeros(0, dtype=np.int64) if ids is None else np.asarray(ids, dtype=np.int64).ravel()
        found.append(Markers(numbers, np.asarray(quads, dtype=np.float64).reshape(-1, 4, 2)))
    return found


def agreement(board: Board, seen: Sequence[Markers]) -> float:
    """Share of neighbouring markers that lie, seen from each other, where the layout puts them.

    A marker's own corners say which way its neighbour lies and how far: no lens distorts so much over two squares.
    """
    seen_offsets, planned = offsets(board, seen)
    if len(planned) == 0:
        return 0.0
    off = np.linalg.norm(seen_offsets * _ratio(seen_offsets, planned) - planned, axis=1)
    return float((off < _TOLERANCE).mean())


def offsets(board: Board, seen: Sequence[Markers]) -> tuple[Array, Array]:
    """From markers to their neighbours, (K, 2): as seen, in the marker's own sides, and as planned, in squares."""
    middles = np.asarray(board.opencv().getObjPoints(), dtype=np.float64)[:, :, :2].mean(axis=1) / board.square
    found, planned = [np.zeros((0, 2))], [np.zeros((0, 2))]
    for markers in seen:
        known = markers.ids < len(middles)
        if known.sum() < _MIN_MARKERS:
            continue
        quads, plan = markers.quads[known], middles[markers.ids[known]]
        right = (quads[:, 1] - quads[:, 0] + quads[:, 2] - quads[:, 3]) / 2.0
        down = (quads[:, 3] - quads[:, 0] + quads[:, 2] - quads[:, 1]) / 2.0
        steps, middle = plan[None] - plan[:, None], quads.mean(axis=1)
        near = np.linalg.norm(steps, axis=-1)
        i, j = np.nonzero((near > 0.5) & (near < _NEIGHBOURS))
        sides = np.stack([right[i], down[i]], axis=-1)
        found.append(np.linalg.solve(sides, (middle[j] - middle[i])[..., None])[..., 0])
        planned.append(steps[i, j])
    return np.concatenate(found), np.concatenate(planned)


def _ratio(seen: Array, planned: Array) -> float:
    """The marker's side in squares."""
    return float(np.median(np.linalg.norm(planned, axis=1) / np.maximum(np.linalg.norm(seen, axis=1), 1e-9)))


def _legible(seen: Sequence[Markers]) -> bool:
    return any(len(markers.ids) >= _MIN_MARKERS for markers in seen)


def _dictionary(sample: Sequence[Image], board: Board) -> str | None:
    """The dictionary whose markers are in the images, the smallest of its family that has enough of them."""
    needed = board.columns * board.rows // 2
    enough = [name for name in DICTIONARIES if dictionary_size(name) >= needed]
    squares = [next((name for name in enough if name.startswith(family)), None) for family in FAMILIES]
    others = [name for name in enough if not name.startswith(FAMILIES)]
    for names in (squares, others):
        counts = {
            name: sum(len(m.ids) for m in find_markers(sample[::2], name) if len(m.ids) >= _MIN_MARKERS)
            for name in names
            if name is not None
        }
        best = max(counts, key=lambda name: counts[name], default=None)
        if best is not None and counts[best]:
            return best
    return None


def _family(dictionary: str) -> str:
    return dictionary[:3] if dictionary.startswith(FAMILIES) else dictionary


def _has_strangers(board: Board, seen: Sequence[Markers]) -> bool:
    """Whether markers that the board does not have are in more than half of the images."""
    legible = [markers for markers in seen if len(markers.ids) >= _MIN_MARKERS]
    strange = sum(bool((markers.ids >= board.columns * board.rows // 2).any()) for markers in legible)
    return strange > len(legible) / 2


def _another(board: Board, seen: Sequence[Markers]) -> str:
    """What is wrong with the board that was named, and which one the images show where that can be told."""
    named = f"the images do not show a board of {board.columns}x{board.rows} squares"
    count = 1 + max(int(markers.ids.max()) for markers in seen if len(markers.ids))
    others = [
        replace(board, columns=columns, rows=rows, legacy=legacy)
        for columns in range(3, _LARGEST)
        # More rows than the markers fill would fit as well.
        for rows in range(-(-2 * count // columns), -(-2 * count // columns) + 2)
        for legacy in (False, True)
        if 3 <= rows <= _LARGEST and count <= columns * rows // 2 <= dictionary_size(board.dictionary)
    ]
    best = max(others, key=lambda other: agreement(other, seen), default=board)
    if agreement(best, seen) >= _AGREEMENT:
        size = f"{best.columns}x{best.rows}"
        return f"{named}: their markers lie as on one of {size}; name that one, or use the right board"
    return f"{named}: their markers lie otherwise; measure the board, count its squares, and name it as it is"


def _check_ratio(board: Board, seen: Sequence[Markers]) -> None:
    """Compares the marker's side, in squares, with what is seen: the squares' own size cannot be seen.

    Raises:
        CalibrationError: they differ.
    """
    ratio, named = _ratio(*offsets(board, seen)), board.marker / board.square
    if abs(ratio - named) > _RATIO * named:
        raise CalibrationError(
            f"a marker's side is about {ratio:.2f} of a square's in the images, but {named:.2f} as it was named: "
            "measure both sides, and give them in metres"
        )
