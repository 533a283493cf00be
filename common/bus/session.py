"""One Zenoh session: publish, subscribe, serve, ask, be present."""

from __future__ import annotations

import itertools
import queue
import sys
import threading
from collections.abc import Callable, Iterable, Mapping
from types import TracebackType
from typing import Any, Generic, Literal, Self, TypeVar, cast

import structlog
import zenoh
from zenoh import ext

from common import wire
from common.bus.configuration import LENDERS, session_config
from common.bus.envelope import Envelope, Source
from common.bus.presence import Lives, Presence, Robots
from common.bus.replays import Asked
from common.bus.statistics import Statistics
from common.bus.subscription import Subscription
from common.bus.tap import Tap
from common.errors import BusError, MalformedMessage, NoAnswer, NoRouter, Refused, RetraverseError, Unavailable
from common.messages import Message, now_ns
from common.topics import FLEET, Delivery, Priority, Topic

M = TypeVar("M", bound=Message)

log = structlog.get_logger()

_PRIORITIES = {
    Priority.REAL_TIME: zenoh.Priority.REAL_TIME,
    Priority.HIGH: zenoh.Priority.INTERACTIVE_HIGH,
    Priority.DATA: zenoh.Priority.DATA,
    Priority.BACKGROUND: zenoh.Priority.BACKGROUND,
}

_SWITCH_INTERVAL_S = 0.0005
"""A busy Python thread would hold Zenoh's callbacks back by 5-10 ms at the interpreter's default."""

_REQUESTS_WAITING = 256

_LATER = "later\n"
"""Before the sentence of a refusal that need not be the last word."""


class Sequence:
    """Numbers the samples of a key; entered for each, so that they leave in the order of their numbers."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._number = 0

    def __enter__(self) -> int:
        self._lock.acquire()
        self._number += 1
        return self._number

    def __exit__(self, *_error: object) -> None:
        self._lock.release()


class Publisher(Generic[M]):
    """The sending end of a topic."""

    def __init__(self, bus: Bus, topic: Topic, key: str) -> None:
        options: dict[str, Any] = {
            "priority": _PRIORITIES[topic.priority],
            "congestion_control": zenoh.CongestionControl.BLOCK if topic.blocking else zenoh.CongestionControl.DROP,
            "express": topic.priority is not Priority.BACKGROUND,
        }
        self._bus = bus
        self.key = key
        self._sequence = bus.sequence_of(key)
        self._publisher: zenoh.Publisher | ext.AdvancedPublisher
        if topic.delivery is Delivery.STATE:
            self._publisher = ext.declare_advanced_publisher(
                bus.session, key, cache=ext.CacheConfig(max_samples=1), publisher_detection=True, **options
            )
        else:
            self._publisher = bus.session.declare_publisher(key, **options)

    def put(self, message: M) -> None:
        """Sends a message; its ``stamp``, where it has one, becomes the sample's."""
        payload = wire.encode(message)
        stamp = getattr(message, "stamp", None) or now_ns()
        with self._sequence as number:
            envelope = Envelope.seal(payload, self._bus.source, number, stamp)
            self._publisher.put(payload, attachment=envelope.pack())
        self._bus.statistics.sent(self.key)


class Bus:
    """A process's connection to its robot's router.

    Used as a context manager: a session that stays open keeps its process from ending.
    """

    def __init__(
        self,
        robot: str,
        process: str,
        endpoint: str,
        *,
        shared_memory: bool = True,
        mode: Literal["client", "router"] = "client",
        timeout: float | None = None,
        uplink: str | None = None,
        access: Mapping[str, Any] | None = None,
    ) -> None:
        """Opens the session.

        A client waits for the router ``timeout`` seconds, and without end if that is None; a router is linked to the
        one at ``uplink``. ``access`` is how it shows who it is, and whom it lets in (:mod:`common.access.link`).

        Raises:
            NoRouter: no router answered in time.
            BusError: the router's port is in use, or the endpoint is none.
        """
        sys.setswitchinterval(_SWITCH_INTERVAL_S)
        self.robot = robot
        self.endpoint = endpoint
        self.source = Source.of(robot, process)
        self.statistics = Statistics()
        self._sequences: dict[str, Sequence] = {}
        self._declared: list[Any] = []
        self._queues: list[queue.SimpleQueue[zenoh.Query | None]] = []
        self._questions = itertools.count(1)
        try:
            self.session = zenoh.open(
                session_config(
                    mode,
                    endpoint,
                    shared_memory=shared_memory,
                    lends=process in LENDERS,
                    timeout=timeout,
                    uplink=uplink,
                    access=access,
                )
            )
        except zenoh.ZError as error:
            if mode == "client":
                raise NoRouter(f"no router answers at {endpoint}: is the robot up?") from None
            reason = str(error).split(" at ", maxsplit=1)[0]
            raise BusError(
                f"cannot open {endpoint} as a {mode}: is its port in use, or its form wrong? ({reason})"
            ) from None
        life = f"vtr/{robot}/life/{self.source.process}/{self.source.life}"
        self._declared.append(self.session.liveliness().declare_token(life))

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Ends the session; what is declared on it goes with it."""
        for waiting in self._queues:
            waiting.put(None)
        self.session.close()  # type: ignore[no-untyped-call]

    def sequence_of(self, key: str) -> Sequence:
        """The sequence of a key: two publishers of it are one source to a receiver."""
        return self._sequences.setdefault(key, Sequence())

    def connected(self) -> bool:
        """Whether the session has a link to the router now."""
        return bool(self.session.info.routers_zid())

    def present(self) -> None:
        """Shows this process to all others until the session ends."""
        key = f"vtr/{self.robot}/alive/{self.source.process}"
        self._declared.append(self.session.liveliness().declare_token(key))

    def presence(self, wake: threading.Event | None = None) -> Presence:
        """Who else is there, from now on."""
        presence = Presence(wake)
        key = f"vtr/{self.robot}/alive/*"
        self._declared.append(self.session.liveliness().declare_subscriber(key, presence.hand_over, history=True))
        return presence

    def lives(self) -> Lives:
        """Which lives of which processes are connected, from now on."""
        lives = Lives()
        key = f"vtr/{self.robot}/life/*/*"
        self._declared.append(self.session.liveliness().declare_subscriber(key, lives.hand_over, history=True))
        return lives

    def robots(self, robot: str = "*") -> Robots:
        """Who is there of the whole fleet, from now on: the robots whose routers this one's is linked to, or one."""
        robots = Robots()
        key = f"vtr/{robot}/alive/*"
        declared = self.session.liveliness().declare_subscriber(key, robots.hand_over, history=True)
        self._declared.append(declared)
        return robots

    def publisher(self, topic: Topic, name: str = "") -> Publisher[Any]:
        """The sending end of a topic, for one sensor, service or environment where its key asks for a name."""
        return Publisher(self, topic, topic.at(self.robot, name))

    def subscribe(
        self,
        topic: Topic,
        name: str = "*",
        *,
        wake: threading.Event | None = None,
        robot: str | None = None,
    ) -> Subscription[Any]:
        """The receiving end of a topic; ``wake`` is set at each arrival, so that a loop can wait for several topics.

        It is that of this robot, of another ``robot``, or of all that are connected where that is ``*``.
        """
        of = FLEET if topic.fleet else robot or self.robot
        subscription = Subscription(topic, topic.message, of, self.statistics, wake)
        declared = self._listen(topic, topic.at(robot or self.robot, name), subscription.hand_over)
        subscription.undeclare = lambda: self._forget(declared)
        return subscription

    def tap(self, keys: Iterable[tuple[Topic, str]]) -> Tap:
        """Every sample of topics, each with the name of its one sensor or service, or ``*`` for all."""
        tap = Tap(self.robot)
        for topic, name in keys:
            self._listen(topic, topic.at(self.robot, name), tap.receiver(topic))
        return tap

    def _listen(self, topic: Topic, key: str, receive: Callable[[zenoh.Sample], None]) -> Any:  # noqa: ANN401, Zenoh's
        declared: Any
        if topic.delivery is Delivery.STATE:
            history = ext.HistoryConfig(detect_late_publishers=True, max_samples=1)
            declared = ext.declare_advanced_subscriber(self.session, key, receive, history=history)
        else:
            declared = self.session.declare_subscriber(key, receive)
        self._declared.append(declared)
        return declared

    def _forget(self, declared: Any) -> None:  # noqa: ANN401, Zenoh's
        """Ends one declaration before the session does."""
        if declared in self._declared:
            self._declared.remove(declared)
            declared.undeclare()

    def serve(self, topic: Topic, handler: Callable[[Any], Message], name: str = "") -> None:
        """Answers a topic's queries, one at a time in a thread of its own; ``name`` is as for a publisher, or ``*``.

        A :class:`RetraverseError` of the handler becomes the asker's refusal; any other error is logged, and refused
        without its details.
        """
        waiting: queue.SimpleQueue[zenoh.Query | None] = queue.SimpleQueue()
        self._queues.append(waiting)
        asked = Asked()

        def hand_over(query: zenoh.Query) -> None:
            if waiting.qsize() < _REQUESTS_WAITING:
                waiting.put(query)

        def answer() -> None:
            while (query := waiting.get()) is not None:
                try:
                    self._answer(topic, key if name != "*" else str(query.key_expr), query, handler, asked)
                except zenoh.ZError as error:
                    # The asker has gone, or this session ends: the next question may still be answered.
                    log.warning("an answer could not be sent", key=key, reason=str(error))
                del query  # its end tells the asker that no more answers come

        key = topic.at(self.robot, name)
        threading.Thread(target=answer, name=f"serve {topic.key}", daemon=True).start()
        self._declared.append(self.session.declare_queryable(key, hand_over, complete=True))

    def ask(self, topic: Topic, question: Message, timeout: float = 2.0, name: str = "") -> Any:  # noqa: ANN401, the topic's answer
        """The answer to a question; ``name`` is the environment's for a topic of the fleet's server.

        Raises:
            Refused: the answerer's own sentence.
            Unavailable: likewise, where the same may be asked again later.
            NoRouter: this session has no link to the router now.
            NoAnswer: nobody answered within ``timeout`` seconds.
            MalformedMessage: the answer is none of this topic's.
        """
        payload = wire.encode(question)
        envelope = Envelope.seal(payload, self.source, next(self._questions), now_ns())
        replies = self.session.get(
            topic.at(self.robot, name),
            payload=payload,
            attachment=envelope.pack(),
            timeout=timeout,
            congestion_control=zenoh.CongestionControl.BLOCK,
            priority=_PRIORITIES[topic.priority],
        )
        for reply in replies:
            if reply.ok is not None:
                return wire.decode(cast("type[Message]", topic.answer), reply.ok.payload.to_bytes())
            if reply.err is not None:
                text = reply.err.payload.to_bytes().decode(errors="replace")
                if text != "Timeout":
                    raise _refusal(text)
        if not self.connected():
            raise NoRouter(f"no router answers at {self.endpoint}: is the robot up?")
        if topic.fleet:
            raise NoAnswer(f"the fleet's server does not answer '{topic.at(self.robot, name)}': is it up, and linked?")
        raise NoAnswer(
            f"nobody answers '{topic.key}' on robot '{self.robot}': is {topic.owners[0]} running? See vtr ps."
        )

    def _answer(
        self, topic: Topic, key: str, query: zenoh.Query, handler: Callable[[Any], Message], asked: Asked
    ) -> None:
        try:
            question = self._question(topic, query, asked)
        except MalformedMessage as error:
            self.statistics.dropped(key, str(error))
            query.reply_err(str(error))
            return
        try:
            reply = wire.encode(handler(question))
        except Unavailable as error:
            query.reply_err(_LATER + str(error))
        except RetraverseError as error:
            query.reply_err(str(error))
        except Exception:
            log.exception("a question could not be answered", key=key)
            query.reply_err(f"{self.source.process} could not answer '{topic.key}'; its log says why")
        else:
            query.reply(key, reply)
            self.statistics.sent(key)

    def _question(self, topic: Topic, query: zenoh.Query, asked: Asked) -> Message:
        payload = b"" if query.payload is None else query.payload.to_bytes()
        attachment = None if query.attachment is None else query.attachment.to_bytes()
        envelope = Envelope.open(attachment, payload)
        if envelope.source.robot != self.robot and not topic.fleet:
            raise MalformedMessage(f"the question is of robot {envelope.source.robot!a}")
        if not asked.first_time(envelope.source, envelope.sequence):
            raise MalformedMessage(f"the question of {envelope.source.process!a} was asked before: it is a replay")
        return wire.decode(topic.message, payload)


def _refusal(text: str) -> Refused | Unavailable:
    """The error that an answerer's refusal stands for."""
    return Unavailable(text.removeprefix(_LATER)) if text.startswith(_LATER) else Refused(text)
