"""A bag as a drive: the sensors' messages that its topics become."""

from __future__ import annotations

import contextlib
from collections import Counter, deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.highlevel import AnyReader, AnyReaderError
from rosbags.interfaces import Connection
from rosbags.typesys import Stores, get_typestore

from common import topics
from common.camera import StereoCamera
from common.messages import CameraFrame, CameraModel, Joystick, StereoFrame, WheelOdometry
from services.sensors.recordings.images import Image, RecordingError
from services.sensors.recordings.organise import scan_message
from services.sensors.recordings.ros.clouds import decode_cloud
from services.sensors.recordings.ros.frames import StaticFrames
from services.sensors.recordings.ros.images import Rectifier, decode_image, rectifier, stereo_camera
from services.sensors.recordings.ros.mapping import Plan, StereoSource, Wish, make_plan
from services.sensors.recordings.ros.mcap_ros1 import Ros1Mcap, is_ros1_mcap
from services.sensors.recordings.timeline import Entry

_STATIC = "/tf_static"
_TOGETHER_NS = 5_000_000
"""Images whose stamps differ by less were taken together."""
_WAITING = 32
"""Images of one side that wait for the other's, where a bag lost some."""
_JOY_AXES = 16

Decode = Callable[[Any, int, int], Iterator[Entry]]
"""What a ROS message becomes: its own, its stamp, and when it was recorded."""


def is_bag(path: Path) -> bool:
    """Whether a path looks like a bag: ROS 1's file, ROS 2's folder, or one of its files."""
    return path.suffix in {".bag", ".db3", ".mcap"} if path.is_file() else (path / "metadata.yaml").is_file()


def open_bag(path: Path, wishes: list[Wish], camera: str = "front", lidar: str = "top") -> BagTimeline:
    """Open a bag; ``camera`` and ``lidar`` are the names that its own become where nothing is wished for.

    Raises:
        RecordingError: it is no bag, or cut short, or what was wished for is not in it.
    """
    with _reading(path) as reader:
        types = {connection.topic: connection.msgtype for connection in reader.connections}
        if reader.message_count == 0 or not types:
            raise RecordingError(f"{path} holds no messages")
        plan = make_plan(types, wishes, camera, lidar)
        sensors = _Sensors(reader, plan)
        total: Counter[str] = Counter()
        for connection in reader.connections:
            if connection.topic in plan.sources:
                total[plan.sources[connection.topic]] += connection.msgcount
        for name in plan.stereo:
            total[topics.STEREO.key.format(name=name)] //= 2
        return BagTimeline(path.stem, reader.start_time, reader.end_time - 1, dict(total), path, plan, sensors.stereo)


@dataclass(frozen=True, slots=True)
class _Pair:
    """A stereo camera of the bag: its calibration, and what brings each side's images to it."""

    camera: StereoCamera
    rectify: dict[str, Rectifier]


@dataclass(frozen=True, slots=True)
class BagTimeline:
    """See :class:`services.sensors.recordings.timeline.Timeline`; ``plan`` says what of the bag is played."""

    name: str
    start_ns: int
    end_ns: int
    counts: dict[str, int]
    path: Path
    plan: Plan
    pairs: dict[str, _Pair] = field(repr=False)

    def entries(self, start_ns: int | None = None, end_ns: int | None = None) -> Iterator[Entry]:
        """The messages, in the order in which the bag recorded them."""
        with _reading(self.path) as reader:
            decoders = _Decoders(self.plan, self.pairs, StaticFrames(_static(reader))).by_source
            chosen = [c for c in reader.connections if c.topic in decoders]
            for connection, time_ns, raw in _messages(self.path, reader, chosen, start_ns, end_ns):
                message = reader.deserialize(raw, connection.msgtype)
                yield from decoders[connection.topic](message, _stamp(message, time_ns), time_ns)


class _Sensors:
    """The calibrations in a bag."""

    def __init__(self, reader: AnyReader, plan: Plan) -> None:
        frames = StaticFrames(_static(reader)) if plan.stereo else StaticFrames(())
        self.stereo: dict[str, _Pair] = {}
        for name, source in plan.stereo.items():
            infos = _first(reader, source.left_info), _first(reader, source.right_info)
            mounting = frames.T_vehicle(infos[0].header.frame_id)
            camera = stereo_camera(infos, mounting, (source.left_info, source.right_info))
            sides = (source.left, source.right)
            made = {topic: rectifier(info, topic) for topic, info in zip(sides, infos, strict=True)}
            self.stereo[name] = _Pair(camera, made)


class _Decoders:
    """What each of the bag's topics becomes."""

    def __init__(self, plan: Plan, pairs: dict[str, _Pair], frames: StaticFrames) -> None:
        self._frames = frames
        self.by_source: dict[str, Decode] = {}
        for name, source in plan.stereo.items():
            joined = _Joiner(name, source, pairs[name])
            self.by_source |= {source.left: joined.left, source.right: joined.right}
        for name, topic in plan.cameras.items():
            self.by_source[topic] = self._camera(name, topic)
        for name, topic in plan.lidars.items():
            self.by_source[topic] = self._lidar(name, topic)
        if plan.odometry is not None:
            self.by_source[plan.odometry] = self._wheels
        if plan.joystick is not None:
            self.by_source[plan.joystick] = self._joystick(plan.button)

    @staticmethod
    def _wheels(message: Any, stamp: int, time_ns: int) -> Iterator[Entry]:  # noqa: ANN401
        twist = message.twist.twist
        v, w = (float(np.clip(value, -100.0, 100.0)) for value in (twist.linear.x, twist.angular.z))
        if np.isfinite([v, w]).all():
            yield Entry(time_ns, topics.WHEEL_ODOMETRY, "", WheelOdometry(stamp=stamp, v=v, w=w))

    @staticmethod
    def _joystick(button: int | None) -> Decode:
        def decode(message: Any, stamp: int, time_ns: int) -> Iterator[Entry]:  # noqa: ANN401
            axes = np.clip(np.nan_to_num(np.asarray(message.axes, np.float64)), -1.0, 1.0)[:_JOY_AXES].tolist()
            held = button is not None and button < len(message.buttons) and bool(message.buttons[button])
            yield Entry(time_ns, topics.JOYSTICK, "", Joystick(stamp=stamp, axes=axes, held=held))

        return decode

    @staticmethod
    def _camera(name: str, topic: str) -> Decode:
        def decode(message: Any, stamp: int, time_ns: int) -> Iterator[Entry]:  # noqa: ANN401
            yield Entry(time_ns, topics.CAMERA, name, CameraFrame(stamp=stamp, image=decode_image(message, topic)))

        return decode

    def _lidar(self, name: str, topic: str) -> Decode:
        def decode(message: Any, stamp: int, time_ns: int) -> Iterator[Entry]:  # noqa: ANN401
            mounting = self._frames.T_vehicle(message.header.frame_id)
            scan = scan_message(decode_cloud(message, stamp, topic), mounting)
            yield Entry(time_ns, topics.LIDAR, name, scan)

        return decode


class _Joiner:
    """Joins the left and right images that were taken together; one whose other side is missing is left out."""

    def __init__(self, name: str, source: StereoSource, pair: _Pair) -> None:
        self._name = name
        self._source = source
        self._pair = pair
        self._model = CameraModel.of(pair.camera)
        self._waiting: dict[str, deque[tuple[int, Any]]] = {
            topic: deque(maxlen=_WAITING) for topic in (source.left, source.right)
        }

    def left(self, message: Any, stamp: int, time_ns: int) -> Iterator[Entry]:  # noqa: ANN401
        """Takes a left image."""
        return self._take(self._source.left, self._source.right, (stamp, message), time_ns)

    def right(self, message: Any, stamp: int, time_ns: int) -> Iterator[Entry]:  # noqa: ANN401
        """Takes a right image."""
        return self._take(self._source.right, self._source.left, (stamp, message), time_ns)

    def _take(self, own: str, other: str, taken: tuple[int, Any], time_ns: int) -> Iterator[Entry]:
        partner = next((p for p in self._waiting[other] if abs(p[0] - taken[0]) < _TOGETHER_NS), None)
        if partner is None:
            self._waiting[own].append(taken)
            return
        self._waiting[other].remove(partner)
        found = {own: taken, other: partner}
        stamp = found[self._source.left][0]
        left, right = (self._image(topic, found[topic][1]) for topic in (self._source.left, self._source.right))
        if left.ndim != right.ndim:
            raise RecordingError(f"'{self._source.left}' is grey and '{self._source.right}' is not, or the other way")
        frame = StereoFrame(stamp=stamp, camera=self._model, left=left, right=right)
        yield Entry(time_ns, topics.STEREO, self._name, frame)

    def _image(self, topic: str, message: Any) -> Image:  # noqa: ANN401
        image = decode_image(message, topic)
        camera = self._pair.camera
        if image.shape[:2] != (camera.height, camera.width):
            raise RecordingError(
                f"an image of '{topic}' is {image.shape[1]}x{image.shape[0]}, its camera info says "
                f"{camera.width}x{camera.height}"
            )
        return self._pair.rectify[topic](image)


@contextlib.contextmanager
def _reading(path: Path) -> Iterator[AnyReader]:
    """The bag, open.

    Raises:
        RecordingError: it cannot be read.
    """
    try:
        with _opened(path) as reader:
            yield reader
    except RecordingError:
        raise
    except OSError as error:
        raise RecordingError(f"cannot read {path} ({error.strerror or error}): check the bag's path") from None
    except Exception as error:  # noqa: BLE001, said below
        # rosbags lets the errors of its storage through, of whatever kind a damaged file brings about.
        reason = " ".join(str(error).split())[:200] or type(error).__name__
        kind = "" if isinstance(error, AnyReaderError) else " (is it cut short, or no bag?)"
        raise RecordingError(f"{path} cannot be read as a bag{kind}: {reason}") from None


def _opened(path: Path) -> contextlib.AbstractContextManager[Any]:
    return (
        Ros1Mcap(path) if is_ros1_mcap(path) else AnyReader([path], default_typestore=get_typestore(Stores.ROS2_HUMBLE))
    )


def _messages(
    path: Path, reader: AnyReader, chosen: list[Connection], start_ns: int | None, end_ns: int | None
) -> Iterator[tuple[Connection, int, bytes]]:
    if not chosen:
        raise RecordingError(f"{path} holds nothing of what was asked for")
    return reader.messages(chosen, start=start_ns, stop=end_ns)


def _first(reader: AnyReader, topic: str) -> Any:  # noqa: ANN401, a class that rosbags makes at run time
    for connection, _, raw in reader.messages([c for c in reader.connections if c.topic == topic]):
        return reader.deserialize(raw, connection.msgtype)
    raise RecordingError(f"the bag's '{topic}' is empty: without a camera info its images mean nothing")


def _static(reader: AnyReader) -> Iterator[Any]:
    chosen = [c for c in reader.connections if c.topic == _STATIC]
    if chosen:
        for connection, _, raw in reader.messages(chosen):
            yield reader.deserialize(raw, connection.msgtype)


def _stamp(message: Any, time_ns: int) -> int:  # noqa: ANN401
    """When the sensor fired, nanoseconds; when it was recorded where the message does not tell."""
    stamp = message.header.stamp
    return int(stamp.sec) * 1_000_000_000 + int(stamp.nanosec) or time_ns
