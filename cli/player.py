"""Plays a recording on a robot's bus: its messages in the sensors' place, and a teach around them if asked for."""

from __future__ import annotations

import contextlib
import math
import time
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any

from cli.errors import CommandError
from cli.operator import LONG_DEADLINE_S, order
from common import topics
from common.bus import Bus, Publisher
from common.errors import RetraverseError
from common.messages import Command, LidarScan, State, StateName, WheelOdometry, now_ns
from services.sensors.recordings.timeline import Entry, Timeline

PROCESS = "player"
"""Its name on the bus; while it is present the sensors service is silent."""

_FIRST_ANSWER_S = 120.0
"""The estimator prepares for a camera that it has not met before."""

_ANSWER_S = 10.0
_AGAIN_S = 2.0
_STATE_S = 10.0
_POLL_S = 0.1
_LONGEST_DELAY_NS = 2_000_000_000
"""From a stamp to the recording of its message; what is longer, or negative, is the difference between two clocks."""

_FASTEST = 100.0
"""Metres or radians a second: wheels report no more."""

OnMessage = Callable[[], None]


@dataclass(frozen=True, slots=True)
class Played:
    """What was played: messages by key, seconds that took, the map taught if any, and the navigator's answer."""

    messages: dict[str, int]
    seconds: float
    map: str | None = None
    text: str = ""


@dataclass(frozen=True, slots=True)
class Part:
    """The part of a recording that is played.

    Attributes:
        start: seconds after the recording's first message at which it begins.
        duration: seconds of the recording that are played.
        keys: the keys that are, all where it is empty.
    """

    start: float = 0.0
    duration: float = math.inf
    keys: frozenset[str] = field(default_factory=frozenset)


class Player:
    """A recording's way to the bus.

    Played ``rate`` times as fast, the robot drives as many times as fast: what is said of its speed is scaled.
    """

    def __init__(self, bus: Bus, recording: Timeline, rate: float = 1.0, part: Part | None = None) -> None:
        """``rate`` is 1 for the recorded speed.

        Raises:
            CommandError: the part holds nothing.
        """
        self._bus = bus
        self._recording = recording
        self._rate = rate
        self._part = part or Part()
        check_part(recording, self._part)
        self._publishers: dict[str, Publisher[Any]] = {}
        self._played: Counter[str] = Counter()
        self._odometry = bus.subscribe(topics.ODOMETRY)
        self._states = bus.subscribe(topics.STATE)
        bus.present()

    def play(self, on_message: OnMessage, *, loop: bool = False) -> Played:
        """Publishes every message at its time, stamped anew, whether anybody listens or not; ``loop`` has no end."""
        start = time.monotonic()
        while True:
            for entry in self._on_time():
                self._publish(entry)
                on_message()
            if not loop:
                return Played(dict(self._played), time.monotonic() - start)

    def teach(self, command: Command, frames: str, on_message: OnMessage) -> Played:
        """Teaches the recording as a map, each frame of which, those under the key ``frames``, the estimator has used.

        It is played at its rate, or as fast as the estimator where that is slower. Every message is read, and the
        first frame shown, before anything is begun, so that what cannot be used changes nothing.

        Raises:
            RecordingError: a message cannot be read.
            CommandError: there are no frames, the estimator does not answer, or the teach did not begin or was ended by
                somebody else; a map that was begun is finished as it stands.
        """
        first = None
        for entry in self._entries():  # a message that cannot be read ends it here
            first = entry if first is None and entry.key == frames else first
        if first is None:
            has = ", ".join(self._recording.counts) or "nothing"
            raise CommandError(f"the recording has no {frames}, which the estimator localizes by: it has {has}")
        self._use(first, 0, _FIRST_ANSWER_S)
        order(self._bus, command)
        try:
            taught = self._await_branch()
            self._played.clear()
            start = time.monotonic()
            for entry in self._on_time():
                if entry.key == frames:
                    self._use(entry, self._played[frames], _ANSWER_S)
                    self._played[frames] += 1
                    self._check_teaching()
                else:
                    self._publish(entry)
                on_message()
            seconds = time.monotonic() - start
            finish = Command(action="finish", start_place=command.start_place, end_place=command.end_place)
            answer = order(self._bus, finish, LONG_DEADLINE_S)
        except BaseException:
            with contextlib.suppress(RetraverseError):
                order(self._bus, Command(action="cancel"), LONG_DEADLINE_S)
            raise
        return Played(dict(self._played), seconds, taught, answer.text)

    def _entries(self) -> Iterator[Entry]:
        """The part's messages."""
        part = self._part
        start = self._recording.start_ns + round(part.start * 1e9)
        end = None if math.isinf(part.duration) else start + round(part.duration * 1e9)
        found = self._recording.entries(start if part.start else None, end)
        return (entry for entry in found if not part.keys or entry.key in part.keys)

    def _on_time(self) -> Iterator[Entry]:
        """The messages, each when it is due; a late one delays those behind it."""
        due, last = time.monotonic(), None
        for entry in self._entries():
            if last is not None:
                due = max(time.monotonic(), due + (entry.time_ns - last) / 1e9 / self._rate)
            last = entry.time_ns
            time.sleep(max(0.0, due - time.monotonic()))
            yield entry

    def _publish(self, entry: Entry) -> None:
        self._send(entry)
        self._played[entry.key] += 1

    def _send(self, entry: Entry) -> int:
        """Publishes a message and returns its new stamp."""
        publisher = self._publishers.get(entry.key)
        if publisher is None:
            publisher = self._publishers[entry.key] = self._bus.publisher(entry.topic, entry.name)
        stamp, changes = self._as_if_now(entry)
        publisher.put(entry.message.model_copy(update=changes))
        return stamp

    def _as_if_now(self, entry: Entry) -> tuple[int, dict[str, Any]]:
        """The new stamp, and all fields that change when a message is played now and at this rate."""
        message, rate = entry.message, self._rate
        delay = entry.time_ns - int(getattr(message, "stamp", entry.time_ns))
        stamp = now_ns() - (round(delay / rate) if 0 <= delay <= _LONGEST_DELAY_NS else 0)
        changes: dict[str, Any] = {"stamp": stamp}
        if rate != 1.0 and isinstance(message, WheelOdometry):
            changes |= {name: _bounded(getattr(message, name) * rate) for name in ("v", "w")}
        elif rate != 1.0 and isinstance(message, LidarScan):
            changes["offsets"] = message.offsets / rate
        return stamp, changes

    def _use(self, entry: Entry, index: int, deadline: float) -> None:
        """Publishes a frame until the estimator has used it: the bus drops frames rather than delay what follows."""
        stamps: set[int] = set()
        end = time.monotonic() + deadline
        again = 0.0
        while (now := time.monotonic()) < end:
            if now >= again:
                stamps.add(self._send(entry))
                again = now + _AGAIN_S
            received = self._odometry.wait(_POLL_S)
            if received is not None and received.message.stamp in stamps:
                return
        raise CommandError(
            f"the estimator did not use frame {index} within {deadline:.0f} s: its log and vtr ps say why"
        )

    def _await_branch(self) -> str:
        """Waits until the state is Teach.Branch, and returns the new map's id."""
        end = time.monotonic() + _STATE_S
        while time.monotonic() < end:
            state = self._state()
            if state is not None and state.name is StateName.TEACH_BRANCH and state.map is not None:
                return state.map.id
            if state is not None and state.name is StateName.TEACH_METRIC_LOCALIZE:
                raise CommandError(
                    f"the robot believes that it stands at {state.target} and would localize there first: "
                    "play the recording into an environment of its own with --environment"
                )
            time.sleep(_POLL_S)
        raise CommandError("the navigator did not begin the teach: vtr state says why")

    def _check_teaching(self) -> None:
        state = self._state()
        if state is not None and state.name is not StateName.TEACH_BRANCH:
            raise CommandError(f"the teach was interrupted: {state.reason or state.name}")

    def _state(self) -> State | None:
        received = self._states.last()
        return None if received is None else received.message


def _bounded(speed: float) -> float:
    """A speed that a message can hold."""
    return max(-_FASTEST, min(_FASTEST, speed))


def check_part(recording: Timeline, part: Part) -> None:
    """Raises a :class:`CommandError` where a part of a recording would be empty."""
    unknown = sorted(part.keys - recording.counts.keys())
    if unknown:
        has = ", ".join(recording.counts) or "nothing that can be played"
        raise CommandError(f"the recording has no '{unknown[0]}': it has {has}")
    if not recording.counts:
        raise CommandError(f"{recording.name} holds no message of a sensor")
    length = (recording.end_ns - recording.start_ns) / 1e9
    if part.start > length:
        raise CommandError(f"--start: the recording is {length:.1f} s long")
