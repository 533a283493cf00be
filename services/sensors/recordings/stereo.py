"""Folders of stereo pairs.

Two layouts are told apart by the files that are there:

* ``left/``, ``right/`` and ``calib.txt`` (two rows, or KITTI's named ones) or ``calib_kitti.txt``, with
  ``poses.txt`` and ``times.txt`` if known;
* KITTI odometry's own: ``sequences/NN/`` with ``image_0/`` and ``image_1/`` (else ``image_2/`` and ``image_3/``),
  ``calib.txt`` and ``times.txt``, and ``poses/NN.txt`` beside ``sequences/``.

Poses are camera 0's, as KITTI gives them, and are brought to the left camera. Without times the pairs are 0.1 s apart.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from common import geometry
from common.camera import StereoCamera
from services.sensors.recordings.calibration import read_poses, read_projections, read_times, stereo_camera
from services.sensors.recordings.images import Image, RecordingError, image_files, read_image, rows_of

Array = NDArray[np.float64]

_PERIOD_NS = 100_000_000


@dataclass(frozen=True, slots=True)
class StereoPair:
    """One rectified pair.

    Attributes:
        stamp_ns: nanoseconds, on the recording's own clock.
        left, right: (H, W) grey or (H, W, 3) RGB, uint8.
    """

    stamp_ns: int
    left: Image
    right: Image


@dataclass(frozen=True, slots=True)
class StereoRecording:
    """A drive: its pairs are decoded one by one as they are asked for.

    Attributes:
        name: of the folder.
        camera: the calibration, with the image size of the first pair.
        stamps_ns: (N,) nanoseconds, increasing.
        poses_truth: (N, 4, 4) ``T_world_left``, or None where unknown.
    """

    name: str
    camera: StereoCamera
    stamps_ns: NDArray[np.int64]
    poses_truth: Array | None
    files_left: tuple[Path, ...] = field(repr=False)
    files_right: tuple[Path, ...] = field(repr=False)

    def __len__(self) -> int:
        return len(self.files_left)

    def __iter__(self) -> Iterator[StereoPair]:
        return (self[i] for i in range(len(self)))

    def __getitem__(self, index: int) -> StereoPair:
        """Decode one pair.

        Raises:
            RecordingError: an image is missing, truncated, or of another size than the first.
        """
        left, right = self._image(self.files_left[index]), self._image(self.files_right[index])
        return StereoPair(int(self.stamps_ns[index]), left, right)

    def every(self, step: int, start: int = 0) -> StereoRecording:
        """The drive of every ``step``-th pair from ``start`` on."""
        chosen = slice(start, None, step)
        return replace(
            self,
            stamps_ns=self.stamps_ns[chosen],
            poses_truth=None if self.poses_truth is None else self.poses_truth[chosen],
            files_left=self.files_left[chosen],
            files_right=self.files_right[chosen],
        )

    def _image(self, file: Path) -> Image:
        image = read_image(file)
        if image.shape[:2] != (self.camera.height, self.camera.width):
            raise RecordingError(
                f"the image {file} is {image.shape[1]}x{image.shape[0]}, "
                f"the recording's are {self.camera.width}x{self.camera.height}: replace it"
            )
        return image


def open_recording(path: str | Path) -> StereoRecording:
    """Open a folder of stereo pairs, in any layout of this module.

    Raises:
        RecordingError: one sentence that names the file that is wrong or missing, and says what to do.
    """
    folder = Path(path).expanduser()
    if not folder.is_dir():
        raise RecordingError(f"there is no folder {folder}: check the recording's path")
    folder = folder.resolve()
    folder_left, folder_right = _image_folders(folder)
    files_left, files_right = image_files(folder_left), image_files(folder_right)
    _check_pairs(folder_left, folder_right, files_left, files_right)
    first = read_image(files_left[0])
    calibration = next(
        (f for f in (folder / "calib.txt", folder / "calib_kitti.txt") if f.is_file()), folder / "calib.txt"
    )
    projections = read_projections(calibration)
    names = _projection_names(projections, folder_left.name, colour=first.ndim == 3)
    camera, T_left_reference = stereo_camera(projections, names, (first.shape[1], first.shape[0]), calibration)
    return StereoRecording(
        name=folder.name,
        camera=camera,
        stamps_ns=_stamps(folder / "times.txt", files_left),
        poses_truth=_truth(folder, files_left, T_left_reference),
        files_left=tuple(files_left),
        files_right=tuple(files_right),
    )


def _image_folders(folder: Path) -> tuple[Path, Path]:
    for left, right in (("left", "right"), ("image_0", "image_1"), ("image_2", "image_3")):
        if (folder / left).is_dir() or (folder / right).is_dir():
            return folder / left, folder / right
    raise RecordingError(
        f"{folder} holds neither left/ and right/ nor image_0/ and image_1/ nor image_2/ and image_3/: "
        "give the folder that holds the pairs"
    )


def _check_pairs(folder_left: Path, folder_right: Path, left: list[Path], right: list[Path]) -> None:
    """Every left image has a right one of the same name."""
    names_left, names_right = [f.stem for f in left], [f.stem for f in right]
    if names_left == names_right:
        return
    alone = sorted(set(names_left) ^ set(names_right))
    if len(left) != len(right) or not alone:
        hint = f" (first without its pair: {alone[0]})" if alone else ""
        raise RecordingError(
            f"{folder_left} holds {len(left)} images and {folder_right} {len(right)}{hint}: "
            "each left image needs its right one"
        )
    raise RecordingError(
        f"{folder_left} and {folder_right} name their images differently, {alone[0]} is in one only: rename"
    )


def _projection_names(projections: dict[str, Array], folder: str, *, colour: bool) -> tuple[str, str]:
    """Which rows are the left and right camera's: in KITTI's numbering 0 and 1 are grey, 2 and 3 coloured."""
    if "left" in projections:
        return "left", "right"
    coloured = colour if folder == "left" else folder == "image_2"
    return ("P2", "P3") if coloured and "P2" in projections else ("P0", "P1")


def _stamps(file: Path, images: list[Path]) -> NDArray[np.int64]:
    if not file.is_file():
        return np.arange(len(images), dtype=np.int64) * _PERIOD_NS
    seconds = read_times(file)
    return np.round(seconds[rows_of(images, len(seconds), file)] * 1e9).astype(np.int64)


def _truth(folder: Path, images: list[Path], T_left_reference: Array) -> Array | None:
    """True poses of the left camera: a rigid offset from camera 0, whose poses the files give."""
    files = (folder / "poses.txt", folder.parent.parent / "poses" / f"{folder.name}.txt")
    file = next((f for f in files if f.is_file()), None)
    if file is None:
        return None
    poses = read_poses(file)
    chosen = poses[rows_of(images, len(poses), file)]
    return T_left_reference @ chosen @ geometry.inverse(T_left_reference)
