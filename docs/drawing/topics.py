"""Who says what to whom, from the table of topics and from what each service's own files name of it."""

from __future__ import annotations

import re
from collections.abc import Iterable
from functools import cache
from pathlib import Path

from common import topics
from common.topics import Delivery, Topic
from docs.drawing.markdown import anchor, table

_ROOT = Path(__file__).resolve().parents[2]
_USED = re.compile(r"\btopics\.([A-Z][A-Z_]*)\b")
_KINDS = {Delivery.FRAME: "latest wins", Delivery.STATE: "in order, the last one kept", Delivery.QUERY: "query"}


@cache
def named() -> dict[str, Topic]:
    """Every topic by its name in the code."""
    return {name: value for name, value in vars(topics).items() if isinstance(value, Topic)}


def of_service(service: str) -> str:
    """Two tables: what a service publishes and answers, and what it listens to and asks."""
    own = [one for one in named().values() if service in one.owners]
    used = [one for one in _used(service) if one not in own]
    parts = []
    if own:
        head = ("publishes or answers", "message", "rate", "old after", "priority")
        parts.append(
            table(head, [(_key(one), _message(one), _rate(one), _age(one), one.priority.value) for one in own])
        )
    if used:
        others = ("listens to or asks", "message", "from")
        parts.append(table(others, [(_key(one), _message(one), ", ".join(_owners(one))) for one in used]))
    return "\n".join(parts) or "It has no topics of its own beside `health`.\n"


def every(chosen: Iterable[Topic]) -> str:
    """One row a topic."""
    head = ("key", "message", "from", "delivery", "rate", "old after", "priority")
    return table(
        head,
        [
            (_key(one), _message(one), ", ".join(_owners(one)), _KINDS[one.delivery], _rate(one), _age(one),
             one.priority.value)
            for one in chosen
        ],
    )  # fmt: skip


def _used(service: str) -> list[Topic]:
    """The topics that a service's own files name, in the table's order."""
    files = (_ROOT / "services" / service).rglob("*.py")
    words = {name for file in files for name in _USED.findall(file.read_text(encoding="utf-8"))}
    return [one for name, one in named().items() if name in words]


def _key(topic: Topic) -> str:
    return f"`{topic.key.replace('{', '<').replace('}', '>')}`"


def _message(topic: Topic) -> str:
    names = [topic.message.__name__, *([topic.answer.__name__] if topic.answer is not None else [])]
    return " → ".join(f"[{name}](../messages.md#{anchor(name)})" for name in names)


def _owners(topic: Topic) -> list[str]:
    return ["every process"] if topic.owners == ("*",) else list(topic.owners)


def _rate(topic: Topic) -> str:
    return f"{topic.rate_hz:g} Hz" if topic.rate_hz else ""


def _age(topic: Topic) -> str:
    return f"{topic.max_age_s:g} s" if topic.max_age_s != float("inf") else ""
