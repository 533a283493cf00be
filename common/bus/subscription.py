"""The receiving end of a topic: Zenoh's callback hands over, the consumer's own thread decodes and checks."""

from __future__ import annotations

import threading
import time
from collections import OrderedDict, deque
from dataclasses import dataclass
from typing import Generic, TypeVar

import zenoh

from common import wire
from common.bus.envelope import Envelope, Source
from common.bus.statistics import Statistics
from common.errors import MalformedMessage
from common.messages import Message
from common.topics import Delivery, Topic

M = TypeVar("M", bound=Message)

_STATE_BACKLOG = 256
_SOURCES_KEPT = 64


@dataclass(frozen=True, slots=True)
class Received(Generic[M]):
    """A valid sample: its message, the monotonic time of its arrival (s), and who sent it."""

    message: M
    arrival: float
    source: Source
    key: str


class Subscription(Generic[M]):
    """The samples of one topic, checked: of this robot, from the topic's owner, well formed, and in sequence.

    Of a FRAME topic only the newest unread sample is kept; of a STATE topic all are, in order. Nothing is decoded
    before it is asked for, and then in the thread that asks.
    """

    def __init__(
        self, topic: Topic, model: type[M], robot: str, statistics: Statistics, wake: threading.Event | None
    ) -> None:
        self.topic = topic
        self._model = model
        self._robot = robot
        self._statistics = statistics
        self._queue: deque[tuple[zenoh.Sample, float]] = deque(
            maxlen=1 if topic.delivery is Delivery.FRAME else _STATE_BACKLOG
        )
        self._arrived = threading.Event()
        self._wake = wake
        self._lock = threading.Lock()
        self._sequences: OrderedDict[tuple[str, Source], int] = OrderedDict()
        self._last: Received[M] | None = None

    def hand_over(self, sample: zenoh.Sample) -> None:
        """Zenoh's callback: keeps the sample for the consumer, and nothing else."""
        self._queue.append((sample, time.monotonic()))
        self._arrived.set()
        if self._wake is not None:
            self._wake.set()

    def poll(self) -> Received[M] | None:
        """The next unread valid sample, or None at once."""
        with self._lock:
            while True:
                self._arrived.clear()
                try:
                    sample, arrival = self._queue.popleft()
                except IndexError:
                    return None
                received = self._check(sample, arrival)
                if received is not None:
                    self._last = received
                    if self._queue:
                        self._arrived.set()
                    return received

    def wait(self, timeout: float) -> Received[M] | None:
        """The next unread valid sample, or None after ``timeout`` seconds."""
        deadline = time.monotonic() + timeout
        while True:
            received = self.poll()
            remaining = deadline - time.monotonic()
            if received is not None or remaining <= 0:
                return received
            self._arrived.wait(remaining)

    def last(self) -> Received[M] | None:
        """The newest valid sample ever received, read or not."""
        while self.poll() is not None:
            pass
        return self._last

    def age(self, now: float | None = None) -> float:
        """Seconds since the arrival of the newest valid sample; infinite before the first."""
        received = self.last()
        return float("inf") if received is None else (time.monotonic() if now is None else now) - received.arrival

    def fresh(self) -> M | None:
        """The newest message unless it is older than its topic's maximum age."""
        received = self.last()
        if received is None or time.monotonic() - received.arrival > self.topic.max_age_s:
            return None
        return received.message

    def _check(self, sample: zenoh.Sample, arrival: float) -> Received[M] | None:
        key = str(sample.key_expr)
        try:
            payload = sample.payload.to_bytes()
            attachment = sample.attachment
            envelope = Envelope.open(None if attachment is None else attachment.to_bytes(), payload)
            self._check_source(envelope.source)
            if not self._in_sequence(key, envelope):
                # A late joiner receives the last state from the publisher's cache and again live.
                if self.topic.delivery is Delivery.FRAME:
                    self._statistics.dropped(key, "out of sequence")
                return None
            return Received(wire.decode(self._model, payload), arrival, envelope.source, key)
        except MalformedMessage as error:
            self._statistics.dropped(key, str(error))
            return None

    def _check_source(self, source: Source) -> None:
        if source.robot != self._robot:
            raise MalformedMessage(f"the sample is of robot '{source.robot}'")
        if self.topic.owners != ("*",) and source.process not in self.topic.owners:
            raise MalformedMessage(f"'{source.process}' does not own this topic")

    def _in_sequence(self, key: str, envelope: Envelope) -> bool:
        identity = (key, envelope.source)
        if envelope.sequence <= self._sequences.get(identity, -1):
            return False
        self._sequences[identity] = envelope.sequence
        self._sequences.move_to_end(identity)
        if len(self._sequences) > _SOURCES_KEPT:
            self._sequences.popitem(last=False)
        return True
