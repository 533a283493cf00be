"""ROS's ``PointCloud2`` as a lidar's scan."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from common.lidar import LidarScan
from services.sensors.recordings.images import RecordingError

_TYPES = {1: "i1", 2: "u1", 3: "<i2", 4: "<u2", 5: "<i4", 6: "<u4", 7: "<f4", 8: "<f8"}
_INTENSITY = ("intensity", "intensities", "reflectivity", "signal")
_RING = ("ring", "channel", "line", "laser_id")
_TIME = ("t", "time", "offset_time", "time_offset", "timestamp")
_LONGEST_S = 1.0
"""Points further from the stamp than this tell the time of another clock."""


def decode_cloud(message: Any, stamp: int, topic: str) -> LidarScan:  # noqa: ANN401, a class made at run time
    """The scan of a cloud, organised where the cloud is and has a row for each beam.

    Raises:
        RecordingError: it has no points in x, y and z, or is not whole.
    """
    cloud = _structured(message, topic)
    names = cloud.dtype.names or ()
    ring = _first(cloud, names, _RING)
    if cloud.shape[0] > cloud.shape[1] > 1 and ring is None:
        # A row for each firing: beams are the columns.
        cloud = cloud.T
    organised = 1 < cloud.shape[0] <= cloud.shape[1]
    if not organised:
        cloud = cloud.reshape(-1)
        ring = None if ring is None else ring.reshape(-1)
    points = np.stack([cloud[axis].astype(np.float32) for axis in "xyz"], axis=-1)
    intensity = _first(cloud, names, _INTENSITY)
    return LidarScan(
        stamp_ns=stamp,
        points=points,
        intensity=np.zeros(cloud.shape, np.float32) if intensity is None else intensity.astype(np.float32),
        rings=None if organised else ring,
        offsets=_offsets(cloud, names, stamp),
    )


def _structured(message: Any, topic: str) -> NDArray[Any]:  # noqa: ANN401
    """The points as a structured array (height, width)."""
    fields = {f.name: (_TYPES.get(int(f.datatype)), int(f.offset)) for f in message.fields}
    if not {"x", "y", "z"} <= fields.keys():
        raise RecordingError(f"a cloud of '{topic}' has no points: its fields are {', '.join(fields) or 'none'}")
    if message.is_bigendian:
        raise RecordingError(f"the clouds of '{topic}' are big-endian, which are not known")
    height, width = int(message.height), int(message.width)
    step, row = int(message.point_step), int(message.row_step)
    data = np.asarray(message.data, np.uint8)
    usable = {name: kind for name, kind in fields.items() if kind[0] is not None}
    ends = [offset + np.dtype(kind).itemsize for kind, offset in usable.values()]
    if row < step * width or len(data) < row * height or max(ends) > step or width * height == 0:
        raise RecordingError(f"a cloud of '{topic}' is not whole: was it cut short?")
    dtype = np.dtype(
        {
            "names": list(usable),
            "formats": [kind for kind, _ in usable.values()],
            "offsets": [offset for _, offset in usable.values()],
            "itemsize": step,
        }
    )
    packed = np.ascontiguousarray(data[: row * height].reshape(height, row)[:, : step * width])
    return packed.view(dtype)


def _first(cloud: NDArray[Any], names: tuple[str, ...], wanted: tuple[str, ...]) -> NDArray[Any] | None:
    """The first field that the cloud has of those wanted."""
    return next((cloud[name] for name in wanted if name in names), None)


def _offsets(cloud: NDArray[Any], names: tuple[str, ...], stamp: int) -> NDArray[np.float32] | None:
    """Seconds from the stamp: whole numbers are nanoseconds, others seconds, since the stamp or since the epoch."""
    times = _first(cloud, names, _TIME)
    if times is None:
        return None
    seconds = times * 1e-9 if times.dtype.kind in "iu" else times.astype(np.float64)
    if seconds.size and np.abs(seconds).max() > _LONGEST_S:
        seconds = seconds - stamp * 1e-9
    return None if np.abs(seconds).max() > _LONGEST_S else seconds.astype(np.float32)
