"""A drive as the messages that its sensors would have published: what all kinds of recordings are played as."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple, Protocol

from common import topics
from common.messages import CameraModel, Message, StereoFrame
from common.topics import Topic
from services.sensors.recordings.lidar import LidarRecording
from services.sensors.recordings.organise import scan_message
from services.sensors.recordings.stereo import StereoRecording

SENSORS: tuple[Topic, ...] = tuple(topic for topic in topics.ALL if "player" in topic.owners)
"""What a recording is played on; everything else on the bus is some service's own."""


class Entry(NamedTuple):
    """A message, its topic with the name of its sensor, and when it came (nanoseconds, the recording's clock)."""

    time_ns: int
    topic: Topic
    name: str
    message: Message

    @property
    def key(self) -> str:
        """Its key below the robot's."""
        return self.topic.key.format(name=self.name)


class Timeline(Protocol):
    """A recording's messages in the order of time.

    Attributes:
        name: of the file or folder.
        start_ns, end_ns: times of the first and the last message.
        counts: messages by key; what :meth:`entries` yields at most.
    """

    @property
    def name(self) -> str: ...  # noqa: D102 - said above
    @property
    def start_ns(self) -> int: ...  # noqa: D102
    @property
    def end_ns(self) -> int: ...  # noqa: D102
    @property
    def counts(self) -> dict[str, int]: ...  # noqa: D102

    def entries(self, start_ns: int | None = None, end_ns: int | None = None) -> Iterator[Entry]:
        """The messages from ``start_ns`` on and before ``end_ns``.

        Raises:
            RecordingError: one of them cannot be read.
        """
        ...


class StereoTimeline:
    """A folder of stereo pairs as the frames of one camera."""

    def __init__(self, recording: StereoRecording, camera: str) -> None:
        self.name = recording.name
        self._recording = recording
        self._camera = camera
        self.start_ns, self.end_ns = int(recording.stamps_ns[0]), int(recording.stamps_ns[-1])
        self.counts = {topics.STEREO.key.format(name=camera): len(recording)}

    def entries(self, start_ns: int | None = None, end_ns: int | None = None) -> Iterator[Entry]:
        """See :class:`Timeline`."""
        model = CameraModel.of(self._recording.camera)
        for index, stamp in enumerate(self._recording.stamps_ns.tolist()):
            if within(stamp, start_ns, end_ns):
                pair = self._recording[index]
                frame = StereoFrame(stamp=max(stamp, 0), camera=model, left=pair.left, right=pair.right)
                yield Entry(stamp, topics.STEREO, self._camera, frame)


class LidarTimeline:
    """A recording of a lidar as the scans of one; where it sits on its vehicle is not known."""

    def __init__(self, recording: LidarRecording, lidar: str) -> None:
        self.name = recording.name
        self._recording = recording
        self._lidar = lidar
        self.start_ns, self.end_ns = int(recording.stamps_ns[0]), int(recording.stamps_ns[-1])
        self.counts = {topics.LIDAR.key.format(name=lidar): len(recording)}

    def entries(self, start_ns: int | None = None, end_ns: int | None = None) -> Iterator[Entry]:
        """See :class:`Timeline`."""
        for index, stamp in enumerate(self._recording.stamps_ns.tolist()):
            if within(stamp, start_ns, end_ns):
                yield Entry(stamp, topics.LIDAR, self._lidar, scan_message(self._recording[index]))


def within(time_ns: int, start_ns: int | None, end_ns: int | None) -> bool:
    """Whether a time lies in a half-open interval whose ends may be missing."""
    return (start_ns is None or time_ns >= start_ns) and (end_ns is None or time_ns < end_ns)
