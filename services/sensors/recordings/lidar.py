"""Recordings of a spinning lidar.

Told apart by the files that are there:

* ``scans/NNNNNN.npz``, or such archives in the folder itself, with ``times.txt`` if known;
* KITTI odometry's ``velodyne/NNNNNN.bin`` with ``times.txt``, ``poses/NN.txt`` two folders up and ``calib.txt``; KITTI
  raw's ``velodyne_points/data/``;
* Ouster's ``.pcap`` with the sensor's ``.json`` beside it, the file or the folder that holds one.

The truth is ``poses.txt`` where there is one, of the lidar itself, else KITTI's. ``poses_*pseudo*.txt`` is a pseudo
truth: another odometry's poses. Without times the scans are 0.1 s apart.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from common import geometry
from common.lidar import LidarScan
from services.sensors.recordings.calibration import read_poses, read_times, read_transform
from services.sensors.recordings.images import RecordingError, number_of, rows_of
from services.sensors.recordings.ouster import Capture, describe, read_sensor
from services.sensors.recordings.scans import read_scan

Array = NDArray[np.float64]

_PERIOD_NS = 100_000_000
_FOLDERS = ("scans", "velodyne", "velodyne_points/data", ".")
_SUFFIXES = frozenset({".npz", ".bin"})


@dataclass(frozen=True, slots=True)
class LidarRecording:
    """A drive: its scans are read one by one as they are asked for.

    Attributes:
        name: of the folder or file.
        stamps_ns: (N,) nanoseconds, increasing.
        poses_truth: (N, 4, 4) ``T_world_lidar``, or None where unknown.
        truth: what the poses are: "truth", or "pseudo truth" of another odometry.
    """

    name: str
    stamps_ns: NDArray[np.int64]
    poses_truth: Array | None
    truth: str
    _indices: NDArray[np.int64] = field(repr=False)
    _read: Callable[[int], LidarScan] = field(repr=False)

    def __len__(self) -> int:
        return len(self._indices)

    def __iter__(self) -> Iterator[LidarScan]:
        return (self[i] for i in range(len(self)))

    def __getitem__(self, index: int) -> LidarScan:
        """Read one scan.

        Raises:
            RecordingError: its file is missing, truncated, or holds no scan.
        """
        return self._read(int(self._indices[index]))

    def select(self, chosen: slice) -> LidarRecording:
        """The drive of some of the scans."""
        poses = None if self.poses_truth is None else self.poses_truth[chosen]
        return LidarRecording(self.name, self.stamps_ns[chosen], poses, self.truth, self._indices[chosen], self._read)


def is_lidar_recording(path: Path) -> bool:
    """Whether a path looks like a recording of a lidar."""
    return path.suffix == ".pcap" or (path.is_dir() and _scan_files(path) is not None)


def open_lidar_recording(path: str | Path) -> LidarRecording:
    """Open a recording in any layout of this module.

    Raises:
        RecordingError: one sentence that names the file that is wrong or missing, and says what to do.
    """
    place = Path(path).expanduser()
    if place.is_file() and place.suffix == ".pcap":
        return _open_capture(place.resolve())
    if not place.is_dir():
        raise RecordingError(f"there is no folder {place}: check the recording's path")
    folder = place.resolve()
    captures = sorted(folder.glob("*.pcap"))
    if len(captures) == 1:
        return _open_capture(captures[0])
    files = None if captures else _scan_files(folder)
    if captures:
        raise RecordingError(f"{folder} holds {len(captures)} captures: give one of them, as {captures[0].name}")
    if files is None:
        raise RecordingError(
            f"{folder} holds no scans: give the folder that holds scans/ or velodyne/, or an Ouster's .pcap"
        )
    _check_numbers(files)
    stamps = _stamps(folder, files)
    poses, truth = _truth(folder, files)
    return LidarRecording(
        folder.name, stamps, poses, truth, np.arange(len(files)), lambda i: read_scan(files[i], int(stamps[i]))
    )


def _scan_files(folder: Path) -> list[Path] | None:
    """The scans of a folder in order, None where it holds none."""
    for name in _FOLDERS:
        if (folder / name).is_dir():
            found = [f for f in (folder / name).iterdir() if f.suffix in _SUFFIXES]
            if found:
                return sorted(found, key=lambda f: (number_of(f), f.name))
    return None


def _check_numbers(files: list[Path]) -> None:
    """Scans are numbered in even steps, or not at all."""
    numbers = np.array([number_of(f) for f in files])
    steps = np.diff(numbers)
    if (numbers >= 0).all() and len(steps) > 0 and (steps != steps.min()).any():
        gap = int(np.argmax(steps != steps.min()))
        raise RecordingError(
            f"the scans of {files[0].parent} are not evenly numbered after {files[gap].name} (next is "
            f"{files[gap + 1].name}): restore the missing one, or renumber them"
        )


def _stamps(folder: Path, files: list[Path]) -> NDArray[np.int64]:
    file = folder / "times.txt"
    if file.is_file():
        seconds = read_times(file)
        return np.round(seconds[rows_of(files, len(seconds), file)] * 1e9).astype(np.int64)
    return np.arange(len(files), dtype=np.int64) * _PERIOD_NS


def _truth(folder: Path, files: list[Path]) -> tuple[Array | None, str]:
    """Poses of the lidar (N, 4, 4), None where they are not known, and what they are."""
    pseudo = sorted(folder.glob("poses_*pseudo*.txt"))
    own = folder / "poses.txt"
    kitti = folder.parent.parent / "poses" / f"{folder.name}.txt"
    file = next((f for f in (own, *pseudo, kitti) if f.is_file()), None)
    if file is None:
        return None, "truth"
    poses = read_poses(file)
    poses = poses[rows_of(files, len(poses), file)]
    if file == kitti:
        # KITTI's are of camera 0, and say where the lidar is beside it.
        T_camera_lidar = read_transform(folder / "calib.txt", "Tr")
        poses = geometry.inverse(T_camera_lidar) @ poses @ T_camera_lidar
    return poses, "pseudo truth" if file in pseudo else "truth"


def _open_capture(file: Path) -> LidarRecording:
    capture = Capture(file, read_sensor(describe(file)))
    stamps = np.array([capture.stamp(i) for i in range(len(capture))], dtype=np.int64)
    beside = file.with_name(f"{file.stem}_poses_kitti.txt")
    poses = read_poses(beside) if beside.is_file() else None
    if poses is not None and len(poses) != len(stamps):
        raise RecordingError(f"{beside} has {len(poses)} rows for {len(stamps)} scans: it must have one for each")
    # Ouster's samples come with poses of Ouster's own odometry.
    return LidarRecording(file.stem, stamps, poses, "pseudo truth", np.arange(len(capture)), capture.__getitem__)
