"""Foxglove's well-known messages of ours, for viewers: pictures, calibrations, clouds, poses and a log.

They repeat what our own messages say, and replay ignores them. Pictures are compressed and come a few times a second:
the pixels are in our own messages.

Frames: ``vehicle``, and each camera and lidar under its topic's key below it. ``route`` is the first vertex of the
route that is being followed, and ``world`` that of the synthetic world's truth.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, Protocol, cast

import cv2
import numpy as np
from foxglove import messages as fox
from numpy.typing import NDArray

from common import topics
from common.geometry import Array
from common.lidar import organised_scan
from common.messages import (
    CameraFrame,
    CameraModel,
    LidarScan,
    Localization,
    Message,
    Odometry,
    Route,
    SafetyStatus,
    State,
    StereoFrame,
    Truth,
)
from common.topics import Topic

ENCODING = SCHEMA_ENCODING = "protobuf"
VEHICLE, ROUTE_FRAME, WORLD = "vehicle", "route", "world"

_PICTURE_PERIOD_NS = 290_000_000
"""Every third frame of a camera of 10 Hz, with room for its jitter."""
_CLOUD_PERIOD_NS = 190_000_000
_JPEG = (cv2.IMWRITE_JPEG_QUALITY, 80)
_FLOAT32 = fox.PackedElementFieldNumericType.Float32


class WellKnown(Protocol):
    """A message of Foxglove's."""

    def encode(self) -> bytes: ...  # noqa: D102 - protobuf
    @staticmethod
    def get_schema() -> Any: ...  # noqa: ANN401, D102 - its name and its protobuf descriptors


@dataclass(frozen=True, slots=True)
class View:
    """One of Foxglove's messages, and the topic that it goes to."""

    topic: str
    message: WellKnown


class Views:
    """Makes the views of the messages of one robot, in the order in which they come."""

    def __init__(self) -> None:
        self._route: Route | None = None
        self._shown: dict[str, int] = {}
        self._said: dict[str, str] = {}
        self._of: dict[Topic, Callable[[str, Any], Iterator[View]]] = {
            topics.STEREO: self._stereo,
            topics.CAMERA: self._camera,
            topics.LIDAR: self._lidar,
            topics.ODOMETRY: self._odometry,
            topics.LOCALIZATION: self._localization,
            topics.ROUTE: self._follow,
            topics.TRUTH: self._truth,
            topics.STATE: self._state,
            topics.SAFETY_STATUS: self._safety,
        }

    def of(self, topic: Topic, key: str, message: Message) -> Iterator[View]:
        """The views of a message, none where no schema fits it or its turn has not come."""
        make = self._of.get(topic)
        return iter(()) if make is None else make(key, message)

    def _due(self, key: str, stamp: int, period: int) -> bool:
        last = self._shown.get(key)
        # A stamp that goes back is that of a clock that was set.
        if last is not None and 0 <= stamp - last < period:
            return False
        self._shown[key] = stamp
        return True

    def _stereo(self, key: str, frame: StereoFrame) -> Iterator[View]:
        if not self._due(key, frame.stamp, _PICTURE_PERIOD_NS):
            return
        time = timestamp(frame.stamp)
        yield View(f"/view/{key}/left", _picture(frame.left, time, key))
        yield View(f"/view/{key}/right", _picture(frame.right, time, key))
        for side in ("left", "right"):
            yield View(f"/view/{key}/{side}/calibration", _calibration(frame.camera, time, key, right=side == "right"))
        yield _frame_view(VEHICLE, key, frame.camera.T_vehicle_camera, time)

    def _camera(self, key: str, frame: CameraFrame) -> Iterator[View]:
        if self._due(key, frame.stamp, _PICTURE_PERIOD_NS):
            yield View(f"/view/{key}", _picture(frame.image, timestamp(frame.stamp), key))

    def _lidar(self, key: str, scan: LidarScan) -> Iterator[View]:
        if self._due(key, scan.stamp, _CLOUD_PERIOD_NS):
            time = timestamp(scan.stamp)
            yield View(f"/view/{key}", _cloud(scan, time, key))
            yield _frame_view(VEHICLE, key, scan.T_vehicle_lidar, time)

    def _odometry(self, key: str, odometry: Odometry) -> Iterator[View]:
        anchor = "odometry" if odometry.vertex is None else f"vertex {odometry.vertex}"
        yield View(f"/view/{key}", _pose_in(anchor, odometry.T_vertex_robot, odometry.stamp))

    def _follow(self, key: str, route: Route) -> Iterator[View]:
        self._route = route
        poses = [_pose(T) for T in route.path]
        yield View(f"/view/{key}", fox.PosesInFrame(frame_id=ROUTE_FRAME, poses=poses))

    def _localization(self, key: str, found: Localization) -> Iterator[View]:
        route = self._route
        if route is None or route.id != found.route or found.trunk_index >= len(route.path):
            yield View(f"/view/{key}", _pose_in(f"vertex {found.trunk}", found.T_trunk_robot, found.stamp))
            return
        T_route_robot = route.path[found.trunk_index] @ found.T_trunk_robot
        yield View(f"/view/{key}", _pose_in(ROUTE_FRAME, T_route_robot, found.stamp))
        yield _frame_view(ROUTE_FRAME, VEHICLE, T_route_robot, timestamp(found.stamp))

    def _truth(self, key: str, truth: Truth) -> Iterator[View]:
        yield View(f"/view/{key}", _pose_in(WORLD, truth.T_world_vehicle, truth.stamp))

    def _state(self, key: str, state: State) -> Iterator[View]:
        text = ": ".join(part for part in (state.name, state.reason, state.waiting_for) if part)
        yield from self._say(key, text, state.stamp, fox.LogLevel.Info)

    def _safety(self, key: str, status: SafetyStatus) -> Iterator[View]:
        rules = ", ".join(reason.rule for reason in status.reasons)
        text = f"stopped by {rules}" if rules else "commands pass"
        yield from self._say(key, text, status.stamp, fox.LogLevel.Warning if rules else fox.LogLevel.Info)

    def _say(self, key: str, text: str, stamp: int, level: fox.LogLevel) -> Iterator[View]:
        """A line of the log where it is not the one before."""
        if self._said.get(key) != text:
            self._said[key] = text
            yield View("/view/log", fox.Log(timestamp=timestamp(stamp), level=level, message=text, name=key))


def timestamp(stamp: int) -> fox.Timestamp:
    """Foxglove's form of nanoseconds since the epoch."""
    return fox.Timestamp(sec=stamp // 1_000_000_000, nsec=stamp % 1_000_000_000)


def _picture(image: NDArray[np.uint8], time: fox.Timestamp, frame: str) -> WellKnown:
    ordered = image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_RGB2BGR)
    data = cv2.imencode(".jpg", ordered, _JPEG)[1].tobytes()
    return fox.CompressedImage(timestamp=time, frame_id=frame, data=data, format="jpeg")


def _calibration(camera: CameraModel, time: fox.Timestamp, frame: str, *, right: bool) -> WellKnown:
    """Of a rectified image: no distortion, and the right one's projection has the baseline in it."""
    shift = -camera.fx * camera.baseline if right else 0.0
    return fox.CameraCalibration(
        timestamp=time,
        frame_id=frame,
        width=camera.width,
        height=camera.height,
        distortion_model="plumb_bob",
        D=[0.0] * 5,
        K=[camera.fx, 0.0, camera.cx, 0.0, camera.fy, camera.cy, 0.0, 0.0, 1.0],
        R=[1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
        P=[camera.fx, 0.0, camera.cx, shift, 0.0, camera.fy, camera.cy, 0.0, 0.0, 0.0, 1.0, 0.0],
    )


def _cloud(scan: LidarScan, time: fox.Timestamp, frame: str) -> WellKnown:
    """Points that came back, (N, 4) float32: x, y, z in metres in the lidar's frame, and the intensity."""
    cloud = organised_scan(scan.stamp, scan.ranges, scan.intensities, scan.elevations, scan.azimuths)
    points = np.concatenate([cloud.points, cloud.intensity[..., None]], axis=-1)[scan.ranges > 0.0]
    fields = [
        fox.PackedElementField(name=name, offset=4 * i, type=_FLOAT32)
        for i, name in enumerate(("x", "y", "z", "intensity"))
    ]
    return fox.PointCloud(
        timestamp=time, frame_id=frame, pose=_pose(np.eye(4)), point_stride=16, fields=fields, data=points.tobytes()
    )


def _parts(T: Array) -> tuple[fox.Vector3, fox.Quaternion]:
    """Position and orientation of a transform (4, 4)."""
    (xx, xy, xz, px), (yx, yy, yz, py), (zx, zy, zz, pz) = T[:3].tolist()
    # Shepperd's method, in plain numbers: arrays of three cost more than all the rest of a message.
    w, x, y, z = max(
        (1.0 + xx + yy + zz, zy - yz, xz - zx, yx - xy),
        (zy - yz, 1.0 + xx - yy - zz, xy + yx, xz + zx),
        (xz - zx, xy + yx, 1.0 - xx + yy - zz, yz + zy),
        (yx - xy, xz + zx, yz + zy, 1.0 - xx - yy + zz),
        key=lambda row: math.hypot(*row),
    )
    norm = math.hypot(w, x, y, z)
    return fox.Vector3(x=px, y=py, z=pz), fox.Quaternion(x=x / norm, y=y / norm, z=z / norm, w=w / norm)


def _pose(T: Array) -> fox.Pose:
    position, orientation = _parts(T)
    return fox.Pose(position=position, orientation=orientation)


def _pose_in(frame: str, T: Array, stamp: int) -> WellKnown:
    return fox.PoseInFrame(timestamp=timestamp(stamp), frame_id=frame, pose=_pose(T))


def _frame_view(parent: str, child: str, T_parent_child: Array, time: fox.Timestamp) -> View:
    translation, rotation = _parts(T_parent_child)
    made = fox.FrameTransform(
        timestamp=time, parent_frame_id=parent, child_frame_id=child, translation=translation, rotation=rotation
    )
    return View("/view/tf", cast("WellKnown", made))
