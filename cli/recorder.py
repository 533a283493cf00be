"""Records a robot's bus: every sample of the chosen topics, checked, decoded and written as it comes."""

from __future__ import annotations

import threading
import time
from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import dataclass

from cli.errors import CommandError
from common import memory, topics, wire
from common.bus import Bus
from common.errors import MalformedMessage
from common.messages import Message
from common.topics import Delivery, Topic
from services.sensors.recordings.mcap import McapWriter
from services.sensors.recordings.mcap.writer import Origin

PROCESS = "recorder"
"""Its name on the bus."""

_POLL_S = 0.1
"""Samples are taken this often: a thread that woke for each would cost more than the writing of most."""
_FLUSH_S = 1.0

OnTick = Callable[["Recorded"], None]


@dataclass(frozen=True, slots=True)
class Recorded:
    """What was recorded so far: messages by key, those that were lost or refused, seconds, bytes and files."""

    messages: dict[str, int]
    lost: dict[str, int]
    refused: dict[str, int]
    seconds: float
    bytes: int
    files: tuple[str, ...]


def choose(keys: Iterable[str]) -> list[tuple[Topic, str]]:
    """The topics with these keys below the robot's, all of them where none is given; ``health`` is every ``health/*``.

    Raises:
        CommandError: there is no such topic.
    """
    published = [topic for topic in topics.ALL if topic.delivery is not Delivery.QUERY]
    chosen: list[tuple[Topic, str]] = []
    for key in keys:
        found = topics.find(key)
        below = [topic for topic in published if topic.key.startswith(f"{key.rstrip('/*')}/")]
        if found is None and not below:
            known = ", ".join(topic.key.format(name="NAME") for topic in published)
            raise CommandError(f"--topics: there is no topic '{key}': choose of {known}")
        chosen += [found] if found is not None else [(topic, "*") for topic in below]
    return list(dict.fromkeys(chosen)) or [(topic, "*") for topic in published]


class BusRecorder:
    """The way from a bus to a writer; it flushes once a second."""

    def __init__(self, bus: Bus, chosen: Iterable[tuple[Topic, str]], writer: McapWriter) -> None:
        self._tap = bus.tap(chosen)
        self._writer = writer
        self._counts: Counter[str] = Counter()
        self._began = time.monotonic()

    def run(self, stop: threading.Event, on_tick: OnTick) -> Recorded:
        """Records until ``stop`` is set, and then what has come until then; ``on_tick`` is called after every flush.

        Raises:
            RecordingError: there is no space, or a file cannot be written.
        """
        memory.keep_freed()
        flushed = time.monotonic()
        stopping = False
        while not stopping:
            stopping = stop.wait(_POLL_S)
            if stopping:
                time.sleep(_POLL_S)  # what was sent before the stop is still on its way
            self._drain()
            if time.monotonic() - flushed >= _FLUSH_S:
                self._writer.flush()
                flushed = time.monotonic()
                on_tick(self.recorded())
        self._writer.close()
        return self.recorded()

    def recorded(self) -> Recorded:
        """The figures so far."""
        lost, refused = (dict(+counter) for counter in (self._tap.lost, self._tap.refused))
        seconds = time.monotonic() - self._began
        files = tuple(str(file) for file in self._writer.files)
        return Recorded(dict(sorted(self._counts.items())), lost, refused, seconds, self._writer.bytes_written, files)

    def _drain(self) -> None:
        while (sample := self._tap.take()) is not None:
            try:
                message: Message = wire.decode(sample.topic.message, sample.payload)
                source = sample.envelope.source
                origin = Origin(source.process, source.life)
                self._writer.write(
                    sample.topic, sample.key, message, origin, sample.envelope.sequence, sample.arrival_ns
                )
            except MalformedMessage:
                self._tap.refused[sample.key] += 1
            else:
                self._counts[sample.key] += 1
