"""A bus in memory, whose samples are a recording's: it has what the estimator uses of :class:`common.bus.Bus`."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

from common import topics
from common.bus import Received
from common.bus.envelope import Source
from common.errors import RetraverseError, Unavailable
from common.messages import Message
from common.topics import Topic
from services.mapstore.store import Store
from services.sensors.recordings.timeline import Entry

_ANSWERS: dict[Topic, Callable[[Store, Any], Message]] = {
    topics.COMMIT: Store.commit,
    topics.MAPS: Store.maps,
    topics.TOPOLOGY: Store.topology,
    topics.SUBMAP: Store.submap,
    topics.APPEARANCE: Store.appearances,
}


def _nothing() -> None:
    """What is done where nothing was asked for."""


class ReplayBus:
    """Time passes from one frame to the next, when the estimator asks for it.

    Attributes:
        outputs: what was published, each at the time of the frame that it follows from.
        now_ns: the recording's time.
        between: called before each frame.
        ended: called after the last.
    """

    def __init__(self, robot: str, entries: Iterator[Entry], frames: str, store: Store) -> None:
        """``frames`` is the key that makes time pass."""
        self.outputs: list[Entry] = []
        self.now_ns = 0
        self.between: Callable[[], object] = _nothing
        self.ended: Callable[[], object] = _nothing
        self._source = Source(robot, "replay", "")
        self._entries = entries
        self._frames = frames
        self._store = store
        self._subscriptions: dict[Topic, ReplaySubscription] = {}

    def subscribe(self, topic: Topic, name: str = "*") -> ReplaySubscription:  # noqa: ARG002, as the bus has it
        """The receiving end of a topic."""
        return self._subscriptions.setdefault(topic, ReplaySubscription(self, topic))

    def publisher(self, topic: Topic, name: str = "") -> ReplayPublisher:
        """The sending end of a topic."""
        return ReplayPublisher(self, topic, name)

    def ask(self, topic: Topic, question: Message, timeout: float = 2.0) -> Message:  # noqa: ARG002, as the bus has it
        """The store's answer."""
        try:
            return _ANSWERS[topic](self._store, question)
        except RetraverseError as error:
            # As the bus would have it: what the store refuses is not there.
            raise Unavailable(str(error)) from None

    def serve(self, topic: Topic, handler: Callable[[Any], Message]) -> None:
        """Nobody asks."""

    def present(self) -> None:
        """Nobody looks."""

    def next_frame(self) -> Received[Any] | None:
        """Lets time pass up to the next frame, and hands it over; None at the end."""
        self.between()
        for entry in self._entries:
            self.now_ns = entry.time_ns
            received = Received(entry.message, entry.time_ns * 1e-9, self._source, entry.key)
            if entry.key == self._frames:
                return received
            subscription = self._subscriptions.get(entry.topic)
            if subscription is not None:
                subscription.newest = received
        self.ended()
        return None


class ReplaySubscription:
    """The newest sample of a topic at the recording's time."""

    def __init__(self, bus: ReplayBus, topic: Topic) -> None:
        self.newest: Received[Any] | None = None
        self._bus = bus
        self._topic = topic

    def wait(self, timeout: float) -> Received[Any] | None:  # noqa: ARG002, as a subscription has it
        """The next frame: only the topic that makes time pass is waited for."""
        return self._bus.next_frame()

    def last(self) -> Received[Any] | None:
        """The newest sample."""
        return self.newest

    def fresh(self) -> Message | None:
        """Its message, unless it is older than its topic's maximum age."""
        if self.newest is None or self._bus.now_ns * 1e-9 - self.newest.arrival > self._topic.max_age_s:
            return None
        message: Message = self.newest.message
        return message


class ReplayPublisher:
    """Keeps what is published."""

    def __init__(self, bus: ReplayBus, topic: Topic, name: str) -> None:
        self._bus = bus
        self._topic = topic
        self._name = name

    def put(self, message: Message) -> None:
        """Keeps a message."""
        self._bus.outputs.append(Entry(self._bus.now_ns, self._topic, self._name, message))
