"""Every sample of some topics in order of arrival, for a recorder: none is skipped, and what is missing is counted."""

from __future__ import annotations

import threading
import time
from collections import Counter, deque
from collections.abc import Callable
from typing import NamedTuple

import zenoh

from common.bus.envelope import Envelope, Source
from common.errors import MalformedMessage
from common.topics import Topic

_MOST_BYTES = 256_000_000
"""Unread samples are held up to this much: a disk that stalls for seconds costs nothing."""


class Sample(NamedTuple):
    """A sample as it travelled: its topic, its key below the robot's, its bytes, and when it arrived (ns, UTC)."""

    topic: Topic
    key: str
    payload: bytes
    envelope: Envelope
    arrival_ns: int


class Tap:
    """Samples wait here until they are taken; the newest ones go when too many wait.

    Attributes:
        lost: samples by key that were published and did not come, or came and found no room: gaps in the sequence.
        refused: samples by key that no receiver would have taken: without envelope, damaged, or not from an owner.
    """

    def __init__(self, robot: str, most_bytes: int = _MOST_BYTES) -> None:
        self.lost: Counter[str] = Counter()
        self.refused: Counter[str] = Counter()
        self._robot = robot
        self._prefix = f"vtr/{robot}/"
        self._most = most_bytes
        self._lock = threading.Lock()
        self._unread: deque[tuple[Topic, zenoh.Sample, int]] = deque()
        self._bytes = 0
        self._sequences: dict[tuple[str, Source], int] = {}

    def receiver(self, topic: Topic) -> Callable[[zenoh.Sample], None]:
        """Zenoh's callback for a topic: keeps the sample, and nothing else."""

        def hand_over(sample: zenoh.Sample) -> None:
            now, size = time.time_ns(), len(sample.payload)
            with self._lock:
                if self._bytes + size <= self._most:
                    self._bytes += size
                    self._unread.append((topic, sample, now))

        return hand_over

    def take(self) -> Sample | None:
        """The next sample, or None at once."""
        while True:
            with self._lock:
                if not self._unread:
                    return None
                topic, raw, arrival = self._unread.popleft()
                self._bytes -= len(raw.payload)
            sample = self._check(topic, raw, arrival)
            if sample is not None:
                return sample

    def _check(self, topic: Topic, raw: zenoh.Sample, arrival: int) -> Sample | None:
        key = str(raw.key_expr).removeprefix(self._prefix)
        try:
            payload = raw.payload.to_bytes()
            envelope = Envelope.open(None if raw.attachment is None else raw.attachment.to_bytes(), payload)
        except MalformedMessage:
            self.refused[key] += 1
            return None
        source = envelope.source
        if source.robot != self._robot or (topic.owners != ("*",) and source.process not in topic.owners):
            self.refused[key] += 1
            return None
        last = self._sequences.get((key, source))
        if last is not None and envelope.sequence <= last:
            # A late joiner receives the last state from the publisher's cache and again live.
            return None
        if last is not None:
            self.lost[key] += envelope.sequence - last - 1
        self._sequences[key, source] = envelope.sequence
        return Sample(topic, key, payload, envelope, arrival)
