"""Writes a robot's bus to MCAP files that are whole after every flush, and split by size.

A flush ends the present chunk and writes it together with the few bytes that end a file. The next flush overwrites
these. So a process that is killed leaves files that every reader opens, without an index in the last one, and loses
what came since the flush before; a file that is closed has an index.
"""

from __future__ import annotations

import contextlib
import os
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path
from types import TracebackType
from typing import IO, NamedTuple, Self, cast

from mcap.data_stream import RecordBuilder
from mcap.records import DataEnd, Footer
from mcap.writer import MCAP0_MAGIC, CompressionType, Writer

from common.errors import MalformedMessage
from common.messages import Message, now_ns
from common.topics import SCHEMA, Topic
from services.sensors.recordings.images import RecordingError
from services.sensors.recordings.mcap import views
from services.sensors.recordings.mcap.encoding import SCHEMA_ENCODING, Encoder, encoding_of, schema_name, schema_of

CHUNK_BYTES = 1_000_000
"""A chunk ends with the message that exceeds this."""

CONFIGURATION = "robot.toml"
"""The attachment that holds the robot's configuration."""

PROFILE = "retraverse"


class Origin(NamedTuple):
    """Who published a message, in which of its lives."""

    process: str
    life: str


class McapWriter:
    """Messages in, files out; a context manager.

    Attributes:
        files: every file written so far, in order.
    """

    def __init__(self, folder: Path, robot: str, split_bytes: int, configuration: str = "") -> None:
        """Writes ``<robot>_<time>_<number>.mcap`` into a folder; ``configuration`` is the robot's TOML.

        Raises:
            RecordingError: the folder or the first file cannot be written.
        """
        self.files: list[Path] = []
        self._folder = folder
        self._robot = robot
        self._split_bytes = split_bytes
        self._configuration = configuration
        self._began = datetime.now(UTC)
        self._encoder = Encoder()
        self._views = views.Views()
        self._file = self._open()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def write(self, topic: Topic, key: str, message: Message, origin: Origin, sequence: int, arrival_ns: int) -> None:
        """Writes a message and its views; ``sequence`` is the source's, ``arrival_ns`` when it came.

        Raises:
            RecordingError: there is no space, or the file cannot be written.
        """
        stamp: int = getattr(message, "stamp", arrival_ns)
        try:
            if self._file.size >= self._split_bytes:
                self._file.close()
                self._file = self._open()
            self._file.add_own(topic, key, self._encoder.encode(message), origin, (sequence, arrival_ns, stamp))
            for view in self._views.of(topic, key, message):
                self._file.add_view(view, (sequence, arrival_ns, stamp))
        except OSError as error:
            raise self._failed(error) from None
        except ValueError as error:
            raise MalformedMessage(f"a message of {key} cannot be written: {error}") from None

    def flush(self) -> None:
        """Makes what was written readable, whatever happens to this process.

        Raises:
            RecordingError: there is no space, or the file cannot be written.
        """
        try:
            self._file.flush()
        except OSError as error:
            raise self._failed(error) from None

    def close(self) -> None:
        """Ends the present file with its index; where that fails the file stays as the last flush left it."""
        self._file.close()

    @property
    def bytes_written(self) -> int:
        """Bytes in all files."""
        return sum(file.stat().st_size for file in self.files)

    def _open(self) -> _File:
        path = self._folder / f"{self._robot}_{self._began:%Y%m%dT%H%M%SZ}_{len(self.files):03d}.mcap"
        try:
            self._folder.mkdir(parents=True, exist_ok=True)
            made = _File(path, self._robot, self._configuration)
        except OSError as error:
            raise RecordingError(f"cannot write {path} ({error.strerror}): choose another folder") from None
        self.files.append(path)
        return made

    def _failed(self, error: OSError) -> RecordingError:
        """The error of a write, after which the file is as the last flush left it."""
        self._file.abandon()
        return RecordingError(
            f"cannot write {self.files[-1]} any more ({error.strerror}): what was recorded until then is kept; "
            "make room, or choose another folder"
        )


class _File:
    """One MCAP file, its schemas and channels."""

    def __init__(self, path: Path, robot: str, configuration: str) -> None:
        self._stream = _WholeFile(path)
        self._writer = Writer(cast("IO[bytes]", self._stream), chunk_size=CHUNK_BYTES, compression=CompressionType.NONE)
        self._schemas: dict[str, int] = {}
        self._channels: dict[tuple[str, Origin | None], int] = {}
        self._ended = False
        self._writer.start(profile=PROFILE)
        self._writer.add_metadata(PROFILE, {"robot": robot, "message_schema": str(SCHEMA)})
        if configuration:
            self._writer.add_attachment(now_ns(), now_ns(), CONFIGURATION, "application/toml", configuration.encode())
        self._stream.commit()

    @property
    def size(self) -> int:
        return self._stream.tell()

    def add_own(self, topic: Topic, key: str, data: bytes, origin: Origin, times: tuple[int, int, int]) -> None:
        channel = self._channels.get((key, origin))
        if channel is None:
            model = topic.message
            schema = self._schema(schema_name(model), SCHEMA_ENCODING, lambda: schema_of(model))
            channel = self._writer.register_channel(f"/{key}", encoding_of(model), schema, origin._asdict())
            self._channels[key, origin] = channel
        self._add(channel, data, times)

    def add_view(self, view: views.View, times: tuple[int, int, int]) -> None:
        channel = self._channels.get((view.topic, None))
        if channel is None:
            known = view.message.get_schema()
            schema = self._schema(known.name, views.SCHEMA_ENCODING, lambda: known.data)
            channel = self._writer.register_channel(view.topic, views.ENCODING, schema)
            self._channels[view.topic, None] = channel
        self._add(channel, view.message.encode(), times)

    def flush(self) -> None:
        self._writer.flush()  # type: ignore[no-untyped-call]

    def close(self) -> None:
        if not self._ended:
            self._ended = True
            try:
                self._writer.finish()  # type: ignore[no-untyped-call]
                self._stream.finish()
            except OSError:
                self._stream.abandon()

    def abandon(self) -> None:
        self._ended = True
        self._stream.abandon()

    def _schema(self, name: str, encoding: str, data: Callable[[], bytes]) -> int:
        if name not in self._schemas:
            self._schemas[name] = self._writer.register_schema(name, encoding, data())
        return self._schemas[name]

    def _add(self, channel: int, data: bytes, times: tuple[int, int, int]) -> None:
        sequence, arrival, stamp = times
        self._writer.add_message(channel, arrival, data, stamp, sequence & 0xFFFFFFFF)


def _ending() -> bytes:
    """What ends a file that has no summary: the end of its data, a footer that names none, and the magic."""
    builder = RecordBuilder()
    DataEnd(0).write(builder)
    Footer(0, 0, 0).write(builder)
    data: bytes = builder.end()  # type: ignore[no-untyped-call]
    return data + MCAP0_MAGIC


_ENDING = _ending()


class _WholeFile:
    """What the MCAP library writes to: bytes reach the file in one piece with an ending, or as the last of it.

    The pieces of a chunk are gathered, and written where the ending before them began.
    """

    def __init__(self, path: Path) -> None:
        self._descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o644)
        self._pieces: list[bytes] = []
        self._gathered = 0
        self._whole = 0
        self._flushed = 0

    def write(self, piece: bytes) -> int:
        """Gathers the bytes of one record, or of several."""
        if piece:
            self._pieces.append(piece)
            self._gathered += len(piece)
            if self._gathered > CHUNK_BYTES:
                self.commit()
        return len(piece)

    def tell(self) -> int:
        """Bytes so far, without the ending."""
        return self._whole + self._gathered

    def flush(self) -> None:
        """As the library calls :meth:`commit`; what was written before the flush before leaves the system's cache.

        Else a long recording would take all of the cache, and each page that it takes costs more than its writing.
        """
        self.commit()
        if hasattr(os, "posix_fadvise") and self._flushed:
            with contextlib.suppress(OSError):  # advice alone: not every file system takes it
                os.posix_fadvise(self._descriptor, 0, self._flushed, os.POSIX_FADV_DONTNEED)
        self._flushed = self._whole

    def commit(self) -> None:
        """Writes what was gathered; the file is whole before and after."""
        if self._pieces:
            self._put([*self._pieces, _ENDING])
            self._whole += self._gathered
            self._pieces, self._gathered = [], 0

    def finish(self) -> None:
        """Writes what was gathered, which has an ending of its own, and closes the file."""
        self._put(self._pieces)
        self._whole += self._gathered
        self._pieces, self._gathered = [], 0
        os.ftruncate(self._descriptor, self._whole)
        self._close()

    def abandon(self) -> None:
        """Closes the file as the last commit left it."""
        self._pieces, self._gathered = [], 0
        if self._descriptor >= 0:
            with contextlib.suppress(OSError):
                # On a full disk the first makes the room that the second needs.
                os.ftruncate(self._descriptor, self._whole)
                os.pwrite(self._descriptor, _ENDING, self._whole)
            self._close()

    def _close(self) -> None:
        os.close(self._descriptor)
        self._descriptor = -1

    def _put(self, pieces: list[bytes]) -> None:
        """Writes pieces one behind the other from where the file was whole; short writes are gone on with."""
        position = self._whole
        waiting = [memoryview(piece) for piece in pieces]
        while waiting:
            done = os.pwritev(self._descriptor, waiting[: os.sysconf("SC_IOV_MAX")], position)
            position += done
            while waiting and done >= len(waiting[0]):
                done -= len(waiting.pop(0))
            if waiting:
                waiting[0] = waiting[0][done:]
