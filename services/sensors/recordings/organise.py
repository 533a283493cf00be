"""A cloud of points as the message of a spinning lidar: a row for each beam, columns in the order of the turn."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from common.geometry import Array
from common.lidar import LidarScan
from common.messages import LidarScan as ScanMessage
from services.sensors.recordings.images import RecordingError

_MOST_BEAMS, _MOST_COLUMNS = 512, 16384
_LEAST_COLUMNS = 16


def scan_message(scan: LidarScan, T_vehicle_lidar: Array | None = None) -> ScanMessage:
    """The message of a scan; where its lidar sits is not known, its frame is taken as the vehicle's.

    Of two points that fall into one cell the nearer one stays.

    Raises:
        RecordingError: its points cannot be told apart by beams.
    """
    organised = scan.points.ndim == 3
    points = scan.points.astype(np.float64)
    # What came back from nowhere has no coordinate, and one that is left says nothing.
    points[~np.isfinite(points).all(axis=-1)] = 0.0
    distance = np.linalg.norm(points, axis=-1)
    azimuth = np.arctan2(points[..., 1], points[..., 0])
    elevation = np.arcsin(np.clip(points[..., 2] / np.where(distance > 0.0, distance, 1.0), -1.0, 1.0))
    offsets = np.zeros(distance.shape) if scan.offsets is None else scan.offsets.astype(np.float64)
    layers = [distance, np.nan_to_num(scan.intensity.astype(np.float64)), elevation, azimuth, offsets]
    if organised:
        ranges, intensities, elevations, azimuths, times = layers
    else:
        ranges, intensities, elevations, azimuths, times = _organise(scan, distance, azimuth, layers)
    return ScanMessage(
        stamp=max(scan.stamp_ns, 0),
        T_vehicle_lidar=np.eye(4) if T_vehicle_lidar is None else T_vehicle_lidar,
        ranges=np.where(ranges <= 1000.0, ranges, 0.0).astype(np.float32),
        intensities=np.clip(intensities, 0.0, 65535.0).astype(np.float32),
        elevations=elevations.astype(np.float32),
        azimuths=azimuths.astype(np.float32),
        offsets=_column_times(times, ranges > 0.0),
    )


def _organise(scan: LidarScan, distance: Array, azimuth: Array, layers: list[Array]) -> list[Array]:
    """Layers (N,) laid out as (H, W) by ring and azimuth; the turn begins where the first point was fired."""
    seen = np.flatnonzero(distance > 0.0)
    if len(seen) == 0:
        raise RecordingError("a scan holds no point")
    rings = _rings_of_turns(azimuth[seen]) if scan.rings is None else scan.rings[seen].astype(np.int64)
    beams, columns = int(rings.max()) + 1, _columns(rings, azimuth[seen])
    if not 2 <= beams <= _MOST_BEAMS or rings.min() < 0:
        raise RecordingError(f"the points of a scan name {beams} rings: that is no spinning lidar")
    turn = np.angle(np.exp(1j * (azimuth[seen] - azimuth[seen[0]])))
    # Which way it turns follows from most of the steps between points that a beam saw one after the other.
    forward = np.sign(np.median([np.median(_steps(turn[rings == ring])) for ring in np.unique(rings)])) or 1.0
    column = np.rint(np.mod(forward * turn, 2.0 * np.pi) / (2.0 * np.pi) * columns).astype(np.int64) % columns
    order = np.argsort(-distance[seen], kind="stable")
    made = [np.zeros((beams, columns)) for _ in layers]
    for target, layer in zip(made, layers, strict=True):
        target[rings[order], column[order]] = layer[seen][order]
    return made


def _rings_of_turns(azimuth: Array) -> NDArray[np.int64]:
    """The ring of each point where the points come beam by beam, a turn of each, as KITTI has them.

    Raises:
        RecordingError: the points' order tells no beams.
    """
    forward = np.sign(np.median(_steps(azimuth))) or 1.0
    # A beam's last point and the next one's first lie on either side of where the turn begins.
    phase = np.mod(forward * (azimuth - azimuth[0]), 2.0 * np.pi)
    rings = np.concatenate([[0], np.cumsum(np.diff(phase) < -np.pi)])
    if not 2 <= rings[-1] + 1 <= _MOST_BEAMS or np.median(np.bincount(rings)) < _LEAST_COLUMNS:
        raise RecordingError("the points of a scan have neither rows nor rings: its lidar cannot be organised")
    return np.asarray(rings, np.int64)


def _steps(turn: Array) -> Array:
    """Angles from point to point, radians, wrapped; one zero where there is no second point."""
    return np.asarray(np.angle(np.exp(1j * np.diff(turn)))) if len(turn) > 1 else np.zeros(1)


def _columns(rings: NDArray[np.int64], azimuth: Array) -> int:
    """As many as the finest ring has steps in a turn: its median step is one column."""
    fullest = np.argmax(np.bincount(rings))
    steps = np.abs(_steps(azimuth[rings == fullest]))
    steps = steps[steps > 1e-5]
    step = float(np.median(steps)) if len(steps) else 2.0 * np.pi
    return int(np.clip(round(2.0 * np.pi / step), _LEAST_COLUMNS, _MOST_COLUMNS))


def _column_times(times: Array, seen: NDArray[np.bool_]) -> Array:
    """Offsets (W,) of columns from points' own (H, W), seconds; a column without points takes its neighbours'."""
    count = seen.sum(axis=0)
    filled = np.flatnonzero(count)
    if len(filled) == 0:
        return np.zeros(times.shape[1])
    mean = np.where(seen, times, 0.0).sum(axis=0)[filled] / count[filled]
    return np.asarray(np.interp(np.arange(times.shape[1]), filled, np.clip(mean, -1.0, 1.0)))
