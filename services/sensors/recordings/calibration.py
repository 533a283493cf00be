"""Calibration, poses and times of a recording, in the text files of KITTI."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from common import geometry
from common.camera import OPTICAL_IN_VEHICLE, StereoCamera
from services.sensors.recordings.images import RecordingError

Array = NDArray[np.float64]

CAMERA_HEIGHT = 1.65
"""Metres of KITTI's cameras above the road."""


def read_projections(file: Path) -> dict[str, Array]:
    """Projection matrices (3, 4) by name (``P0``…), or ``left`` and ``right`` for two rows without names.

    Raises:
        RecordingError: the file is missing, or a row is not 12 finite numbers.
    """
    rows: dict[str, Array] = {}
    for number, line in enumerate(_lines(file), start=1):
        name, colon, numbers = line.partition(":")
        if not colon:
            name, numbers = ("left", "right")[len(rows)] if len(rows) < 2 else f"row{number}", line
        name = name.strip()
        if colon and not (len(name) == 2 and name.startswith("P") and name[1].isdecimal()):
            continue
        rows[name] = _numbers(numbers, 12, file, number).reshape(3, 4)
    return rows


def stereo_camera(
    projections: dict[str, Array], names: tuple[str, str], size: tuple[int, int], file: Path
) -> tuple[StereoCamera, Array]:
    """The camera of two rectified projections, and ``T_left_reference`` (4, 4): the left camera beside camera 0.

    ``names`` are those of the left and right projection, ``size`` is (width, height), ``file`` is named in errors.

    Raises:
        RecordingError: a projection is missing, not a rectified pair's, or has no baseline.
    """
    for name in names:
        if name not in projections:
            raise RecordingError(f"{file} has no projection of the {_side(name, names)} camera ({name}): add its row")
    left, right = (projections[name] for name in names)
    for name, P in zip(names, (left, right), strict=True):
        if not (P[0, 0] > 0.0 and P[1, 1] > 0.0):
            raise RecordingError(
                f"{file} gives the {_side(name, names)} camera no positive focal length: correct its row"
            )
    if not np.allclose(left[:, :3], right[:, :3], rtol=1e-4, atol=1e-4):
        raise RecordingError(
            f"{file} is not of a rectified pair: the two cameras must share their focal lengths and centre"
        )
    # P = K [I | t]: the camera's place beside camera 0 is -t.
    t_left, t_right = (np.linalg.solve(left[:, :3], P[:, 3]) for P in (left, right))
    baseline = float(t_left[0] - t_right[0])
    if not baseline > 1e-4:
        raise RecordingError(
            f"{file} has no baseline: the right camera must lie to the right of the left one, not by {baseline:.4f} m"
        )
    T_vehicle_camera = OPTICAL_IN_VEHICLE.copy()
    T_vehicle_camera[2, 3] = CAMERA_HEIGHT
    fx, fy, cx, cy = (float(x) for x in (left[0, 0], left[1, 1], left[0, 2], left[1, 2]))
    camera = StereoCamera(size[0], size[1], fx, fy, cx, cy, baseline, T_vehicle_camera)
    return camera, geometry.transform(np.eye(3), t_left)


def read_poses(file: Path) -> Array:
    """Poses (N, 4, 4) of 12 numbers a row.

    Raises:
        RecordingError: a row is not 12 finite numbers, or not a rigid transform.
    """
    rows = [_numbers(line, 12, file, number) for number, line in enumerate(_lines(file), start=1)]
    poses = np.tile(np.eye(4), (len(rows), 1, 1))
    poses[:, :3] = np.array(rows).reshape(-1, 3, 4)
    # KITTI prints seven digits, so its rotations are not rotations to the last.
    if not geometry.is_transform(poses, tolerance=1e-3):
        raise RecordingError(f"{file} holds a row that is no rigid transform: correct it, or remove the file")
    return geometry.normalize(poses)


def read_transform(file: Path, name: str) -> Array:
    """The transform (4, 4) of the row ``name: `` and 12 numbers.

    Raises:
        RecordingError: the file or the row is missing, or it is no rigid transform.
    """
    for number, line in enumerate(_lines(file), start=1):
        found, colon, numbers = line.partition(":")
        if colon and found.strip() == name:
            T = np.eye(4)
            T[:3] = _numbers(numbers, 12, file, number).reshape(3, 4)
            if not geometry.is_transform(T, tolerance=1e-3):
                raise RecordingError(f"{file}, row {number}: {name} is no rigid transform")
            return geometry.normalize(T)
    raise RecordingError(f"{file} has no row {name}: add it, or remove the poses")


def read_times(file: Path) -> Array:
    """Times (N,) in seconds.

    Raises:
        RecordingError: a row is not a finite number, or the times do not increase.
    """
    times = np.array([_numbers(line, 1, file, number)[0] for number, line in enumerate(_lines(file), start=1)])
    if (np.diff(times) <= 0.0).any():
        raise RecordingError(f"{file}: the times do not increase after row {int(np.argmax(np.diff(times) <= 0.0)) + 1}")
    return times


def _side(name: str, names: tuple[str, str]) -> str:
    return "left" if name == names[0] else "right"


def _lines(file: Path) -> list[str]:
    try:
        text = file.read_text(encoding="utf-8")
    except OSError as error:
        raise RecordingError(f"cannot read {file} ({error.strerror}): restore it") from error
    except UnicodeDecodeError as error:
        raise RecordingError(f"{file} is not a text file: restore it") from error
    return [line for line in text.splitlines() if line.strip()]


def _numbers(text: str, count: int, file: Path, row: int) -> Array:
    try:
        values = np.array([float(word) for word in text.split()])
    except ValueError as error:
        raise RecordingError(f"{file}, row {row}: '{text.strip()[:40]}' holds what is not a number") from error
    if len(values) != count:
        raise RecordingError(f"{file}, row {row}: {count} numbers are needed, there are {len(values)}")
    if not np.isfinite(values).all():
        raise RecordingError(f"{file}, row {row}: a number is not finite")
    return values
