"""The pairs of images in a folder."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from services.sensors.calibration.board import Image
from services.sensors.calibration.detection import as_grey
from services.sensors.calibration.errors import CalibrationError
from services.sensors.recordings.images import SUFFIXES, read_image

_SIDE = re.compile(r"(?i)(?:^|(?<=[^a-z]))(left|right|l|r)(?=[^a-z]|$)")
"""The word of a file's name that tells the side: left01, cam-right_3, 0007_l."""


@dataclass(frozen=True, slots=True)
class PairFiles:
    """Where a pair's images are: two files, or one that holds the left image beside the right one."""

    name: str
    left: Path
    right: Path | None

    def read(self) -> tuple[str, Image, Image]:
        """The name, and both images (H, W), grey.

        Raises:
            RecordingError: a file is missing, truncated or no image.
            CalibrationError: an image that should hold both cannot be halved.
        """
        left = as_grey(read_image(self.left))
        if self.right is not None:
            return self.name, left, as_grey(read_image(self.right))
        if left.shape[1] % 2:
            raise CalibrationError(
                f"the image {self.left} is {left.shape[1]} pixels wide, which are no two images side by side"
            )
        half = left.shape[1] // 2
        return self.name, left[:, :half].copy(), left[:, half:].copy()


@dataclass(frozen=True, slots=True)
class Folder:
    """The pairs of a folder, in the order of their names, and images without a partner, by name."""

    pairs: tuple[PairFiles, ...]
    lonely: tuple[str, ...]

    def __len__(self) -> int:
        return len(self.pairs)

    def __iter__(self) -> Iterator[tuple[str, Image, Image]]:
        return (pair.read() for pair in self.pairs)


def find_pairs(folder: Path, *, side_by_side: bool = False) -> Folder:
    """The pairs of ``left/`` and ``right/`` with equal names, of names with the words left and right, or of one file.

    Raises:
        CalibrationError: there is no such folder, or no pair in it.
    """
    if not folder.is_dir():
        raise CalibrationError(f"there is no folder {folder}: give the one that holds the pairs of images")
    if side_by_side:
        files = _images(folder)
        if not files:
            raise CalibrationError(f"{folder} holds no images")
        return Folder(tuple(PairFiles(file.stem, file, None) for file in files), ())
    if (folder / "left").is_dir() or (folder / "right").is_dir():
        sides = {side: {f.stem: f for f in _images(folder / side)} for side in ("left", "right")}
    else:
        sides = _by_name(_images(folder))
    left, right = sides["left"], sides["right"]
    both = sorted(left.keys() & right.keys(), key=lambda name: (len(name), name))
    if not both:
        raise CalibrationError(
            f"{folder} holds no pairs of images: put them into left/ and right/ under equal names, or name them "
            "left_01.png and right_01.png, or give --side-by-side"
        )
    lonely = sorted(f"{side} {name}" for side in sides for name in sides[side] if name not in both)
    return Folder(tuple(PairFiles(name, left[name], right[name]) for name in both), tuple(lonely))


def _images(folder: Path) -> list[Path]:
    if not folder.is_dir():
        return []
    return sorted(f for f in folder.iterdir() if f.suffix.lower() in SUFFIXES)


def _by_name(files: list[Path]) -> dict[str, dict[str, Path]]:
    """Files by side, and by their names without the side."""
    sides: dict[str, dict[str, Path]] = {"left": {}, "right": {}}
    for file in files:
        found = _SIDE.search(file.stem)
        if found is None:
            continue
        side = "left" if found[1].lower().startswith("l") else "right"
        name = (file.stem[: found.start()] + file.stem[found.end() :]).strip("_-. ") or file.stem
        sides[side][name] = file
    return sides
