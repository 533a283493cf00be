"""What each process of a robot, and each role that comes from elsewhere, may do: all of it from the table of topics.

A right is something that goes one way over a link. ``INGRESS`` is what the other end sends to this router, ``EGRESS``
what this router sends there. Whatever no right covers is refused.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from enum import Enum, StrEnum

from common.topics import ALL, FLEET, OF_THE_FLEET, Delivery, Topic

ANY = "*"
"""In a key: any robot's."""

_OPERATOR = "operator"
_GUESTS = (_OPERATOR, "console", "recorder")
"""Processes that people run elsewhere."""
_EVERYTHING = ("**", "**/@adv/**")
"""Two, for ``**`` stands for no part of a key that begins with ``@``, as those of Zenoh's advanced publishers do."""


class Flow(StrEnum):
    """Which way."""

    INGRESS = "ingress"
    EGRESS = "egress"


class Kind(Enum):
    """What travels, as the kinds of messages that Zenoh tells apart."""

    SAMPLES = ("put", "delete")
    SUBSCRIPTIONS = ("declare_subscriber", "declare_liveliness_subscriber", "liveliness_query")
    QUESTIONS = ("query",)
    ANSWERS = ("declare_queryable", "reply")
    TOKENS = ("liveliness_token", "reply")


@dataclass(frozen=True, slots=True)
class Right:
    """Something that may pass: what, which way, and under which key expressions."""

    kind: Kind
    flow: Flow
    keys: tuple[str, ...]


def processes() -> tuple[str, ...]:
    """Every process that may be on a robot's bus, whether it writes, asks, or only looks."""
    named = {name for topic in ALL for name in (*topic.owners, *topic.askers)} | set(_GUESTS)
    return tuple(sorted(named - {"*"}))


def of_process(robot: str, process: str) -> list[Right]:
    """A robot's own process, at the robot's router: it reads all, and writes, answers and asks what the table says."""
    asks = [*_asked(robot, lambda topic: _may_ask(topic, process)), *_histories(ANY)]
    return [
        *_of_owner(robot, lambda topic: process in topic.owners, process),
        Right(Kind.QUESTIONS, Flow.INGRESS, tuple(asks)),
        # The fleet's router lets a robot hear of no other, whatever it would like to hear.
        Right(Kind.SUBSCRIPTIONS, Flow.INGRESS, _below(ANY)),
        *(Right(kind, Flow.EGRESS, _EVERYTHING) for kind in Kind),
    ]


def of_uplink(robot: str) -> list[Right]:
    """The fleet's router, at a robot's: what operators may send or ask, and what the server publishes and answers."""
    sent = _keys(robot, ALL, lambda topic: _OPERATOR in topic.owners)
    asked = _asked(robot, lambda topic: _may_ask(topic, _OPERATOR), ALL)
    return [
        Right(Kind.SAMPLES, Flow.INGRESS, (*sent, *_below(FLEET))),
        Right(Kind.QUESTIONS, Flow.INGRESS, (*asked, *_histories(ANY, ALL))),
        Right(Kind.SUBSCRIPTIONS, Flow.INGRESS, _EVERYTHING),
        Right(Kind.ANSWERS, Flow.INGRESS, _below(FLEET)),
        Right(Kind.TOKENS, Flow.INGRESS, (*_below(FLEET), *_present(robot, *_GUESTS))),
        *_all_of(Flow.EGRESS, _below(robot)),
        Right(Kind.QUESTIONS, Flow.EGRESS, _below(FLEET)),
        Right(Kind.SUBSCRIPTIONS, Flow.EGRESS, _below(robot) + _below(FLEET)),
    ]


def of_server() -> list[Right]:
    """The server's own processes, at the fleet's router: they write what is the server's, and look at all."""
    asks = [
        *_asked(FLEET, lambda topic: _may_ask(topic, _OPERATOR), OF_THE_FLEET),
        *_histories(ANY),
    ]
    return [
        *_all_of(Flow.INGRESS, _below(FLEET)),
        Right(Kind.QUESTIONS, Flow.INGRESS, tuple(asks)),
        Right(Kind.SUBSCRIPTIONS, Flow.INGRESS, _below(ANY)),
        *(Right(kind, Flow.EGRESS, _EVERYTHING) for kind in Kind),
    ]


def of_robot(robot: str) -> list[Right]:
    """A robot, at the fleet's router: its own keys and no other's, and what any robot may ask the server."""
    own = _below(robot)
    asks = [
        *_asked(FLEET, lambda topic: topic.askers != (_OPERATOR,), OF_THE_FLEET),
        *_histories(ANY, OF_THE_FLEET),
        *own,
    ]
    sent = _keys(robot, ALL, lambda topic: _OPERATOR in topic.owners)
    return [
        *_all_of(Flow.INGRESS, own),
        Right(Kind.QUESTIONS, Flow.INGRESS, tuple(asks)),
        Right(Kind.SUBSCRIPTIONS, Flow.INGRESS, own + _below(FLEET)),
        Right(Kind.SAMPLES, Flow.EGRESS, (*sent, *_below(FLEET))),
        Right(Kind.QUESTIONS, Flow.EGRESS, own),
        Right(Kind.SUBSCRIPTIONS, Flow.EGRESS, _EVERYTHING),
        Right(Kind.ANSWERS, Flow.EGRESS, _below(FLEET)),
        Right(Kind.TOKENS, Flow.EGRESS, (*_below(FLEET), *_present(robot, *_GUESTS))),
    ]


def of_operator() -> list[Right]:
    """An operator, at the fleet's router: reads all, sends what an operator owns, asks what an operator may."""
    return [
        Right(Kind.SAMPLES, Flow.INGRESS, tuple(_keys(ANY, ALL, lambda topic: _OPERATOR in topic.owners))),
        *_of_reader(lambda topic: _may_ask(topic, _OPERATOR)),
    ]


def of_viewer() -> list[Right]:
    """A viewer, at the fleet's router: reads all, and asks only what changes nothing."""
    return _of_reader(lambda topic: topic.askers == ("*",))


def _of_reader(may_ask: Callable[[Topic], bool]) -> list[Right]:
    asks = [*_asked(ANY, may_ask), *_histories(ANY)]
    return [
        Right(Kind.QUESTIONS, Flow.INGRESS, tuple(asks)),
        Right(Kind.SUBSCRIPTIONS, Flow.INGRESS, _below(ANY)),
        # Every session shows that it lives; that alone makes nobody believe anything that it may not send.
        Right(Kind.TOKENS, Flow.INGRESS, _present(ANY, *_GUESTS)),
        *(Right(kind, Flow.EGRESS, _EVERYTHING) for kind in Kind if kind is not Kind.QUESTIONS),
    ]


def _of_owner(robot: str, owns: Callable[[Topic], bool], process: str) -> list[Right]:
    """The samples and answers of a process, its health, and its presence."""
    samples = [*_keys(robot, ALL, lambda topic: owns(topic) and _published(topic))]
    samples += [topic.at(robot, process) for topic in ALL if topic.owners == ("*",)]
    answers = _keys(robot, ALL, lambda topic: owns(topic) and topic.delivery is Delivery.QUERY)
    stated = _keys(robot, ALL, lambda topic: owns(topic) and topic.delivery is Delivery.STATE)
    caches = [f"{key}/@adv/**" for key in stated]
    return [
        Right(Kind.SAMPLES, Flow.INGRESS, (*samples, *caches)),
        Right(Kind.ANSWERS, Flow.INGRESS, (*answers, *stated, *caches)),
        Right(Kind.TOKENS, Flow.INGRESS, (*_present(robot, process), *_present(FLEET, process), *caches)),
    ]


def _present(robot: str, *processes: str) -> tuple[str, ...]:
    """The tokens by which processes and their lives are seen."""
    return tuple(key for name in processes for key in (f"vtr/{robot}/alive/{name}", f"vtr/{robot}/life/{name}/*"))


def _may_ask(topic: Topic, process: str) -> bool:
    return topic.askers == ("*",) or process in topic.askers


def _published(topic: Topic) -> bool:
    return topic.delivery is not Delivery.QUERY


def _asked(of: str, may: Callable[[Topic], bool], table: Iterable[Topic] = (*ALL, *OF_THE_FLEET)) -> list[str]:
    return _keys(of, table, lambda topic: topic.delivery is Delivery.QUERY and may(topic))


def _histories(of: str, table: Iterable[Topic] = (*ALL, *OF_THE_FLEET)) -> list[str]:
    """What a late joiner asks publishers of states for."""
    return [f"{key}/@adv/**" for key in _keys(of, table, lambda topic: topic.delivery is Delivery.STATE)]


def _keys(of: str, table: Iterable[Topic], wanted: Callable[[Topic], bool]) -> list[str]:
    return [topic.at(of, ANY) for topic in table if wanted(topic)]


def _below(of: str) -> tuple[str, ...]:
    return f"vtr/{of}/**", f"vtr/{of}/**/@adv/**"


def _all_of(flow: Flow, keys: tuple[str, ...]) -> list[Right]:
    return [Right(kind, flow, keys) for kind in (Kind.SAMPLES, Kind.ANSWERS, Kind.TOKENS)]
