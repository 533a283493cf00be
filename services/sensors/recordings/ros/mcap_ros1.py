"""MCAP files of ROS 1's messages, as ``mcap convert drive.bag`` makes them, read as ``rosbags`` reads its own kinds."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any, NamedTuple, Self

from mcap.reader import NonSeekingReader, SeekingReader
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from services.sensors.recordings.images import RecordingError

PROFILE, _ROS2, _ENCODING = "ros1", "ros2", "ros1msg"
_MOST_BYTES = 1 << 30
"""Of one record: a length beyond it is damage, not data."""


class Ros1Channel(NamedTuple):
    """A topic, the type of its messages by ROS 2's way of naming them, and how many there are."""

    topic: str
    msgtype: str
    msgcount: int


class Ros1Mcap:
    """What is used of rosbags' ``AnyReader``, for a file of the profile ``ros1`` that has its index."""

    def __init__(self, path: Path) -> None:
        """Opens it.

        Raises:
            RecordingError: it has no index, or holds no messages of ROS 1.
            OSError, McapError: it cannot be read.
        """
        self._stream = path.open("rb")
        self._reader = SeekingReader(self._stream, validate_crcs=True, record_size_limit=_MOST_BYTES)
        self._store = get_typestore(Stores.EMPTY)
        summary = self._reader.get_summary()
        if summary is None or summary.statistics is None:
            raise RecordingError(f"{path} has no index: mcap recover makes it one")
        figures = summary.statistics
        self.message_count = figures.message_count
        self.start_time, self.end_time = figures.message_start_time, figures.message_end_time + 1
        self.connections: list[Ros1Channel] = []
        for channel in summary.channels.values():
            schema = summary.schemas.get(channel.schema_id)
            if schema is not None and schema.encoding == _ENCODING:
                kind = schema.name.replace("/", "/msg/")
                self._store.register(get_types_from_msg(schema.data.decode(), kind))
                counted = figures.channel_message_counts.get(channel.id, 0)
                self.connections.append(Ros1Channel(channel.topic, kind, counted))

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._stream.close()

    def messages(
        self, connections: Sequence[Ros1Channel], start: int | None = None, stop: int | None = None
    ) -> Iterator[tuple[Ros1Channel, int, bytes]]:
        """The messages of some topics from ``start`` on and before ``stop``, nanoseconds, with their times."""
        wanted = {connection.topic: connection for connection in connections}
        for _, channel, message in self._reader.iter_messages(list(wanted), starting_at=start, ending_before=stop):
            yield wanted[channel.topic], message.log_time, message.data

    def deserialize(self, raw: bytes, kind: str) -> Any:  # noqa: ANN401, a class that rosbags makes at run time
        """The message in bytes."""
        return self._store.deserialize_ros1(raw, kind)


def is_ros1_mcap(path: Path) -> bool:
    """Whether a file is an MCAP that says of itself that its messages are of ROS 1.

    Raises:
        RecordingError: it says that they are of neither ROS.
        McapError: it is damaged.
    """
    if not (path.is_file() and path.suffix == ".mcap"):
        return False
    with path.open("rb") as stream:
        profile = NonSeekingReader(stream, record_size_limit=_MOST_BYTES).get_header().profile
    if profile not in (PROFILE, _ROS2):
        raise RecordingError(
            f"{path} is an MCAP of the profile '{profile}', which cannot be played: give one of vtr record, or of ROS"
        )
    return bool(profile == PROFILE)
