"""Lidar scans in files of one scan each: numpy archives, and KITTI's ``.bin``."""

from __future__ import annotations

import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from common.lidar import LidarScan
from services.sensors.recordings.images import RecordingError

_QUANTUM = 0.0025
"""Metres of a step of ``xyz_q``."""


def read_scan(file: Path, stamp_ns: int) -> LidarScan:
    """The scan of a file.

    Raises:
        RecordingError: the file is missing, cut short, or of another form.
    """
    return _read_bin(file, stamp_ns) if file.suffix == ".bin" else _read_npz(file, stamp_ns)


def _read_bin(file: Path, stamp_ns: int) -> LidarScan:
    """KITTI's: rows of float32 x, y, z and intensity, one beam's turn after the other, corrected for the motion."""
    try:
        content = file.read_bytes()
    except OSError as error:
        raise RecordingError(f"cannot read the scan {file} ({error.strerror}): restore it") from error
    if len(content) == 0 or len(content) % 16:
        raise RecordingError(
            f"the scan {file} is truncated ({len(content)} bytes, not four floats a point): copy it again"
        )
    values = np.frombuffer(content, dtype="<f4").reshape(-1, 4)
    return LidarScan(stamp_ns, np.ascontiguousarray(values[:, :3]), np.ascontiguousarray(values[:, 3]))


def _read_npz(file: Path, stamp_ns: int) -> LidarScan:
    """An archive of ``xyz_q`` and ``intensity``, or of an Ouster's ``XYZ``, ``RANGE`` and reflectivity."""
    try:
        with np.load(file, allow_pickle=False) as archive:
            arrays = {name: archive[name] for name in archive.files}
    except FileNotFoundError as error:
        raise RecordingError(f"cannot read the scan {file} ({error.strerror}): restore it") from error
    except (OSError, ValueError, zipfile.BadZipFile, EOFError, KeyError) as error:
        raise RecordingError(f"the scan {file} is truncated or no numpy archive: copy it again") from error
    if "xyz_q" in arrays:
        _check(arrays, "xyz_q", file, 2)
        points = (arrays["xyz_q"] * _QUANTUM).astype(np.float32)
        return LidarScan(stamp_ns, points, _intensity(arrays, ("intensity",), points, file))
    if "XYZ" in arrays:
        return _organised(arrays, file, stamp_ns)
    raise RecordingError(f"the scan {file} holds neither xyz_q nor XYZ but {', '.join(arrays) or 'nothing'}")


def _organised(arrays: Mapping[str, NDArray[Any]], file: Path, stamp_ns: int) -> LidarScan:
    _check(arrays, "XYZ", file, 3)
    points = arrays["XYZ"].astype(np.float32)
    if "RANGE" in arrays:
        if arrays["RANGE"].shape != points.shape[:2]:
            raise RecordingError(f"the scan {file} has {arrays['RANGE'].shape} ranges for {points.shape[:2]} points")
        points[arrays["RANGE"] == 0] = 0.0
    offsets = None
    if "timestamp" in arrays:
        times = arrays["timestamp"].astype(np.int64)
        if times.shape != (points.shape[1],):
            raise RecordingError(f"the scan {file} has {len(times)} times for {points.shape[1]} columns")
        if times.max() > 0:
            stamp_ns = int(times.max())
            seconds = np.where(times > 0, (times - stamp_ns) * 1e-9, 0.0)
            offsets = np.broadcast_to(seconds, points.shape[:2]).astype(np.float32)
    # The columns of a destaggered image were fired a few columns apart, a millisecond or two: no matter.
    intensity = _intensity(arrays, ("REFLECTIVITY", "SIGNAL"), points, file)
    return LidarScan(stamp_ns, points, intensity, offsets=offsets, reflectivity="REFLECTIVITY" in arrays)


def _check(arrays: Mapping[str, NDArray[Any]], name: str, file: Path, dimensions: int) -> None:
    value = arrays[name]
    if value.dtype.kind not in "fiu" or value.ndim != dimensions or value.shape[-1] != 3 or value.size == 0:
        raise RecordingError(f"the scan {file} has an array {name} {value.dtype}{value.shape}, not one of points")


def _intensity(
    arrays: Mapping[str, NDArray[Any]], names: tuple[str, ...], points: NDArray[np.float32], file: Path
) -> NDArray[np.float32]:
    name = next((name for name in names if name in arrays), None)
    if name is None:
        raise RecordingError(f"the scan {file} has no intensity ({' or '.join(names)}): record the sensor's intensity")
    value = arrays[name]
    if value.dtype.kind not in "fiu" or value.shape != points.shape[:-1]:
        raise RecordingError(f"the scan {file} has {value.shape} intensities for {points.shape[:-1]} points")
    return value.astype(np.float32)
