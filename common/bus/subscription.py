"""The receiving end of a topic: Zenoh's callback hands over, the consumer's own thread decodes and checks."""

from __future__ import annotations

import threading
import time
from collections import OrderedDict, deque
from collections.abc import Callable
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
_FRAME_KEYS = 64
_SOURCES_KEPT = 64
_ANY = "*"


@dataclass(frozen=True, slots=True)
class Received(Generic[M]):
    """A valid sample: its message, the monotonic time of its arrival (s), and who sent it."""

    message: M
    arrival: float
    source: Source
    key: str


class Subscription(Generic[M]):
    """The samples of one topic, checked: of its robot, from the topic's owner, well formed, and in sequence.

    Of a FRAME topic only the newest unread sample of each key is kept; of a STATE topic all are, in order. Nothing is
    decoded before it is asked for, and then in the thread that asks.

    Attributes:
        topic: what it is of.
        undeclare: ends it at the session, which sets this.
    """

    def __init__(
        self,
        topic: Topic,
        model: type[M],
        robot: str,
        statistics: Statistics,
        wake: threading.Event | None,
    ) -> None:
        self.topic = topic
        self._model = model
        self._robot = robot
        self._statistics = statistics
        self._unread = _NewestByKey() if topic.delivery is Delivery.FRAME else _Backlog()
        self._arrived = threading.Event()
        self._wake = wake
        self._lock = threading.Lock()
        self._sequences: OrderedDict[tuple[str, Source], int] = OrderedDict()
        self._last: Received[M] | None = None
        self.undeclare: Callable[[], None] | None = None

    def close(self) -> None:
        """Hears nothing any more; without it a subscription lasts as long as its session."""
        if self.undeclare is not None:
            self.undeclare()

    def hand_over(self, sample: zenoh.Sample) -> None:
        """Zenoh's callback: keeps the sample for the consumer, and nothing else."""
        self._unread.add(sample, time.monotonic())
        self._arrived.set()
        if self._wake is not None:
            self._wake.set()

    def poll(self) -> Received[M] | None:
        """The next unread valid sample, or None at once."""
        with self._lock:
            self._arrived.clear()
            while (unread := self._unread.take()) is not None:
                received = self._check(*unread)
                if received is not None:
                    self._last = received
                    return received
            return None

    def wait(self, timeout: float) -> Received[M] | None:
        """The next unread valid sample, or None after ``timeout`` seconds."""
        deadline = time.monotonic() + timeout
        while True:
            received = self.poll()
            remaining = deadline - time.monotonic()
            if received is not None or remaining <= 0:
                return received
            # Set by every arrival after the poll has begun, so that none is slept through.
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
            self._check_source(key, envelope.source)
            identity = (key, envelope.source)
            newest = self._sequences.get(identity, -1)
            if envelope.sequence <= newest:
                # A late joiner receives the last state from the publisher's cache and again live.
                if self.topic.delivery is Delivery.FRAME or envelope.sequence < newest:
                    self._statistics.dropped(key, "out of sequence")
                return None
            message = wire.decode(self._model, payload)
            self._remember(identity, envelope.sequence)
            return Received(message, arrival, envelope.source, key)
        except MalformedMessage as error:
            self._statistics.dropped(key, str(error))
            return None

    def _check_source(self, key: str, source: Source) -> None:
        of = key.split("/")[1] if self._robot == _ANY else self._robot
        if source.robot != of:
            raise MalformedMessage(f"the sample is of robot {source.robot!a}")
        if self.topic.owners != ("*",) and source.process not in self.topic.owners:
            raise MalformedMessage(f"{source.process!a} does not own this topic")

    def _remember(self, identity: tuple[str, Source], sequence: int) -> None:
        self._sequences[identity] = sequence
        self._sequences.move_to_end(identity)
        if len(self._sequences) > _SOURCES_KEPT:
            self._sequences.popitem(last=False)


class _Backlog:
    """Unread samples in order of arrival; the oldest goes when there are too many."""

    def __init__(self) -> None:
        self._samples: deque[tuple[zenoh.Sample, float]] = deque(maxlen=_STATE_BACKLOG)

    def add(self, sample: zenoh.Sample, arrival: float) -> None:
        self._samples.append((sample, arrival))

    def take(self) -> tuple[zenoh.Sample, float] | None:
        try:
            return self._samples.popleft()
        except IndexError:
            return None


class _NewestByKey:
    """The newest unread sample of each key, so that one sensor or service does not hide another."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._samples: OrderedDict[str, tuple[zenoh.Sample, float]] = OrderedDict()

    def add(self, sample: zenoh.Sample, arrival: float) -> None:
        key = str(sample.key_expr)
        with self._lock:
            self._samples[key] = (sample, arrival)
            self._samples.move_to_end(key)
            if len(self._samples) > _FRAME_KEYS:
                self._samples.popitem(last=False)

    def take(self) -> tuple[zenoh.Sample, float] | None:
        with self._lock:
            return self._samples.popitem(last=False)[1] if self._samples else None
