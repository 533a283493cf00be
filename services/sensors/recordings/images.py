"""Image files: found in order, and decoded in full or not at all."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from common.errors import RetraverseError

Image = NDArray[np.uint8]

SUFFIXES = frozenset({".png", ".jpg", ".jpeg", ".webp", ".pgm", ".ppm", ".bmp", ".tif", ".tiff"})
_PNG_START, _PNG_END = b"\x89PNG", b"IEND\xaeB\x60\x82"
_JPEG_START, _JPEG_END = b"\xff\xd8", b"\xff\xd9"


class RecordingError(RetraverseError):
    """A recording cannot be read; the sentence names the file and says what to do."""


def image_files(folder: Path) -> list[Path]:
    """The images of a folder, ordered by name.

    Raises:
        RecordingError: there is no such folder, it holds no images, or one is missing from a row of numbers.
    """
    if not folder.is_dir():
        raise RecordingError(f"there is no folder {folder}: check the recording's path")
    files = sorted((f for f in folder.iterdir() if f.suffix.lower() in SUFFIXES), key=lambda f: (number_of(f), f.name))
    if not files:
        raise RecordingError(f"{folder} holds no images: copy the recording's images there")
    numbers = np.array([number_of(f) for f in files])
    steps = np.diff(numbers)
    # Every second image of a drive is a drive as well, so any constant step is one.
    if (numbers >= 0).all() and len(steps) > 0 and (steps != steps.min()).any():
        gap = int(np.argmax(steps != steps.min()))
        raise RecordingError(
            f"the images of {folder} are not evenly numbered after {files[gap].name} (next is {files[gap + 1].name}): "
            "restore the missing one, or renumber them"
        )
    return files


def number_of(file: Path) -> int:
    """The number that a file's name is, -1 if it is none."""
    return int(file.stem) if file.stem.isdecimal() else -1


def rows_of(files: list[Path], count: int, table: Path) -> NDArray[np.int64]:
    """The rows (N,) of a table of ``count`` rows that belong to N images or scans: by their numbers, else in order.

    Raises:
        RecordingError: the table has not one row for each.
    """
    if count == len(files):
        return np.arange(count)
    numbers = np.array([number_of(f) for f in files], dtype=np.int64)
    if (numbers >= 0).all() and numbers.max() < count:
        return numbers
    raise RecordingError(f"{table} has {count} rows for {len(files)} files: it must have one for each")


def read_image(file: Path) -> Image:
    """Decode an image to (H, W) grey or (H, W, 3) RGB, uint8; 16 bits are reduced to their upper 8, alpha is dropped.

    Raises:
        RecordingError: the file is missing, cut short, or no image.
    """
    try:
        content = file.read_bytes()
    except OSError as error:
        raise RecordingError(f"cannot read the image {file} ({error.strerror}): restore it") from error
    if _is_truncated(content):
        raise RecordingError(f"the image {file} is truncated: copy it again")
    try:
        decoded = cv2.imdecode(np.frombuffer(content, dtype=np.uint8), cv2.IMREAD_UNCHANGED)
    except cv2.error:
        decoded = None
    if decoded is None:
        raise RecordingError(f"the image {file} cannot be decoded: copy it again")
    return _as_grey_or_rgb(np.asarray(decoded), file)


def _is_truncated(content: bytes) -> bool:
    """Whether the file's own end mark is missing: decoders fill up what is missing without a word."""
    if content.startswith(_PNG_START):
        return _PNG_END not in content[-64:]
    if content.startswith(_JPEG_START):
        return _JPEG_END not in content[-1024:]
    return len(content) == 0


def _as_grey_or_rgb(image: NDArray[Any], file: Path) -> Image:
    if image.dtype == np.uint16:
        image = (image >> 8).astype(np.uint8)
    if image.dtype != np.uint8:
        raise RecordingError(f"the image {file} holds {image.dtype} values: convert it to 8 or 16 bits")
    if image.ndim == 3 and image.shape[2] == 1:
        image = image[:, :, 0]
    if image.ndim == 3:
        image = cv2.cvtColor(image[:, :, :3], cv2.COLOR_BGR2RGB)
    return np.ascontiguousarray(image, dtype=np.uint8)
