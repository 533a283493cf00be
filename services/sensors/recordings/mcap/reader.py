"""Reads what ``writer`` wrote, whole or cut short: as a drive, or every message of ours."""

from __future__ import annotations

import contextlib
import struct
from collections import Counter
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import IO, NamedTuple

from mcap.exceptions import EndOfFile, McapError
from mcap.reader import NonSeekingReader, SeekingReader
from mcap.records import Channel
from mcap.records import Message as McapMessage
from mcap.stream_reader import CRCValidationError
from zstandard import ZstdError

from common import topics
from common.errors import MalformedMessage
from services.sensors.recordings.images import RecordingError
from services.sensors.recordings.mcap.encoding import decode
from services.sensors.recordings.mcap.writer import CONFIGURATION, PROFILE
from services.sensors.recordings.timeline import SENSORS, Entry, within

MAGIC = b"\x89MCAP0\r\n"
"""How an MCAP file begins."""

_MOST_BYTES = 1 << 30
"""Of one record: a length beyond it is damage, not data."""

_CUT = (EndOfFile, struct.error)
_DAMAGED = (McapError, CRCValidationError, ZstdError, ValueError, KeyError, MemoryError, RuntimeError)


class Recorded(NamedTuple):
    """A message of ours as it was recorded, by whom it was published, and its number there."""

    entry: Entry
    process: str
    sequence: int


class _Contents(NamedTuple):
    """Messages of ours by key, the first's and the last's time, and whether the file has an end."""

    counts: Counter[str]
    start_ns: int
    end_ns: int
    whole: bool


@dataclass(frozen=True)
class McapTimeline:
    """The files of one recording, in order; see :class:`services.sensors.recordings.timeline.Timeline`."""

    name: str
    files: tuple[Path, ...]

    @property
    def start_ns(self) -> int:
        """When the first message came."""
        return min(part.start_ns for part in self._contents)

    @property
    def end_ns(self) -> int:
        """When the last message came."""
        return max(part.end_ns for part in self._contents)

    @property
    def all_counts(self) -> dict[str, int]:
        """Messages of ours by key."""
        total: Counter[str] = Counter()
        for part in self._contents:
            total.update(part.counts)
        return dict(sorted(total.items()))

    @property
    def counts(self) -> dict[str, int]:
        """Those of sensors."""
        return {key: count for key, count in self.all_counts.items() if _is_sensors(key)}

    @property
    def whole(self) -> bool:
        """Whether every file has its index: a recorder that was killed leaves one without."""
        return all(part.whole for part in self._contents)

    def entries(self, start_ns: int | None = None, end_ns: int | None = None) -> Iterator[Entry]:
        """The sensors' messages."""
        return (found.entry for found in self.recorded(list(self.counts), start_ns, end_ns))

    def recorded(
        self, keys: Collection[str] | None = None, start_ns: int | None = None, end_ns: int | None = None
    ) -> Iterator[Recorded]:
        """Every message of ours, or those of some keys, in the order in which they came.

        Raises:
            RecordingError: a message is damaged, or of another version.
        """
        wanted = {f"/{key}" for key in (self.all_counts if keys is None else keys)}
        for file in self.files:
            with file.open("rb") as stream:
                for channel, message in _messages(file, stream, wanted, start_ns, end_ns):
                    yield _recorded(file, channel, message)

    def configuration(self) -> str:
        """The robot's TOML when it was recorded, empty where none was kept."""
        with self.files[0].open("rb") as stream, contextlib.suppress(*_CUT, *_DAMAGED):
            for attachment in NonSeekingReader(stream).iter_attachments():
                if attachment.name == CONFIGURATION:
                    return attachment.data.decode()
        return ""

    @cached_property
    def _contents(self) -> tuple[_Contents, ...]:
        found = tuple(_contents(file) for file in self.files)
        if not any(part.counts for part in found):
            raise RecordingError(f"{self.name} holds no message of a robot's bus: nothing was recorded in it")
        return tuple(part for part in found if part.counts)


def is_mcap_recording(path: Path) -> bool:
    """Whether a file is an MCAP of ours, or a folder holds some."""
    if path.is_dir():
        files = sorted(path.glob("*.mcap"))
        return bool(files) and not (path / "metadata.yaml").exists() and is_mcap_recording(files[0])
    return path.is_file() and _profile(path) == PROFILE


def open_mcap(path: Path) -> McapTimeline:
    """Open a file that ``vtr record`` wrote, or the folder of one recording.

    Raises:
        RecordingError: it is none, or the folder holds several.
    """
    files = sorted(path.glob("*.mcap")) if path.is_dir() else [path]
    if not files or not files[0].exists():
        raise RecordingError(f"there is no recording at {path}: check its path")
    recordings = sorted({file.stem.rpartition("_")[0] for file in files})
    if len(recordings) > 1:
        raise RecordingError(f"{path} holds {len(recordings)} recordings: give one of their files, as {files[0].name}")
    for file in files:
        if not is_mcap_recording(file):
            raise RecordingError(f"{file} is no recording of vtr record: give one, or a bag")
    opened = McapTimeline(path.stem, tuple(files))
    opened.whole  # noqa: B018, a file that holds nothing is told now
    return opened


def _is_sensors(key: str) -> bool:
    found = topics.find(key)
    return found is not None and found[0] in SENSORS


def _profile(file: Path) -> str | None:
    """The profile of an MCAP file, None where it is none."""
    try:
        with file.open("rb") as stream:
            return str(NonSeekingReader(stream, record_size_limit=_MOST_BYTES).get_header().profile)
    except (*_CUT, *_DAMAGED, StopIteration, OSError):
        return None


def _contents(file: Path) -> _Contents:
    with file.open("rb") as stream:
        with contextlib.suppress(*_CUT, *_DAMAGED, StopIteration, OSError):
            summary = SeekingReader(stream, record_size_limit=_MOST_BYTES).get_summary()
            if summary is not None and summary.statistics is not None:
                figures = summary.statistics
                counts: Counter[str] = Counter()
                for identity, number in figures.channel_message_counts.items():
                    counts[summary.channels[identity].topic.removeprefix("/")] += number
                ours = Counter({key: n for key, n in counts.items() if topics.find(key) is not None})
                return _Contents(ours, figures.message_start_time, figures.message_end_time, whole=True)
        stream.seek(0)
        counts, times = Counter(), [0, 0]
        for channel, message in _linear(file, stream, None, None, None):
            if topics.find(channel.topic.removeprefix("/")) is not None:
                times = [times[0] or message.log_time, message.log_time]
                counts[channel.topic.removeprefix("/")] += 1
        return _Contents(counts, times[0], times[1], whole=False)


def _messages(
    file: Path, stream: IO[bytes], wanted: set[str], start_ns: int | None, end_ns: int | None
) -> Iterator[tuple[Channel, McapMessage]]:
    """By the index where there is one, else from the beginning up to where the file was cut."""
    reader = SeekingReader(stream, validate_crcs=True, record_size_limit=_MOST_BYTES)
    indexed = False
    with contextlib.suppress(*_CUT, *_DAMAGED, StopIteration, OSError):
        summary = reader.get_summary()
        indexed = summary is not None and bool(summary.chunk_indexes)
    if not indexed:
        stream.seek(0)
        yield from _linear(file, stream, wanted, start_ns, end_ns)
        return
    try:
        for _, channel, message in reader.iter_messages(wanted, starting_at=start_ns, ending_before=end_ns):
            yield channel, message
    except (*_CUT, *_DAMAGED) as error:
        raise _damage(file, error) from None


def _linear(
    file: Path, stream: IO[bytes], wanted: set[str] | None, start_ns: int | None, end_ns: int | None
) -> Iterator[tuple[Channel, McapMessage]]:
    reader = NonSeekingReader(stream, validate_crcs=True, record_size_limit=_MOST_BYTES)
    try:
        for _, channel, message in reader.iter_messages(wanted, log_time_order=False):
            if within(message.log_time, start_ns, end_ns):
                yield channel, message
    except _CUT:
        return
    except _DAMAGED as error:
        raise _damage(file, error) from None


def _damage(file: Path, error: Exception) -> RecordingError:
    reason = " ".join(str(error).split())[:200]
    return RecordingError(f"{file} is damaged ({reason or type(error).__name__}): restore it")


def _recorded(file: Path, channel: Channel, message: McapMessage) -> Recorded:
    key = channel.topic.removeprefix("/")
    found = topics.find(key)
    if found is None:
        raise RecordingError(f"{file} holds '{key}', which is no topic of this version")
    topic, name = found
    try:
        decoded = decode(topic.message, message.data)
    except MalformedMessage as error:
        raise RecordingError(f"{file}: a message of '{key}' cannot be read: {error}") from None
    entry = Entry(message.log_time, topic, name, decoded)
    return Recorded(entry, channel.metadata.get("process", ""), message.sequence)
