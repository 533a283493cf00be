"""The newest sample of a topic, from senders that are believed.

The bus drops what is not of the topic's owner, and what repeats an earlier number of the same life of a process. What
carries the name of a life that is not connected is a recording, and a second life of a process beside one that speaks
is no process that was restarted.
"""

from __future__ import annotations

from collections.abc import Container
from typing import Generic, TypeVar

from common.bus import Received, Subscription
from common.bus.envelope import Source
from common.messages import Message

M = TypeVar("M", bound=Message)


class Speakers:
    """Which life of each process is believed: one that is connected, as long as it speaks."""

    def __init__(self, connected: Container[Source], silence: float) -> None:
        """``silence``, seconds: so long after the last sample of a life another one of its process may take over."""
        self._connected = connected
        self._silence = silence
        self._present: dict[str, tuple[Source, float]] = {}

    def believes(self, source: Source, arrival: float) -> bool:
        """Whether a sample that arrived at ``arrival`` (s, monotonic) is of a life that is believed, from now on."""
        if source not in self._connected:
            return False
        speaker, last = self._present.get(source.process, (source, arrival))
        if source != speaker and speaker in self._connected and arrival - last <= self._silence:
            return False
        self._present[source.process] = source, arrival
        return True


class Heard(Generic[M]):
    """The newest believed sample of a subscription."""

    def __init__(self, subscription: Subscription[M], speakers: Speakers) -> None:
        self._subscription = subscription
        self._speakers = speakers
        self._last: Received[M] | None = None

    def news(self) -> list[Received[M]]:
        """The believed samples since the last call, oldest first."""
        found = []
        while (received := self._subscription.poll()) is not None:
            if self._speakers.believes(received.source, received.arrival):
                found.append(received)
                self._last = received
        return found

    def last(self) -> Received[M] | None:
        """The newest believed sample ever received, read or not."""
        self.news()
        return self._last
