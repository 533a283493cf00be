"""What Zenoh's router refuses, read from its own log: it tells nobody else.

Zenoh logs each decision at its finest level, in several lines: which subject may not do what, and then, in the same
thread, that a message was dropped. Only the two together are a refusal, for it also works out in advance what it
would refuse, and drops messages for other reasons. What it does not pass *on* to somebody without the right
(``egress``) is no attempt of anybody's.
"""

from __future__ import annotations

import re
from collections import OrderedDict
from collections.abc import Iterator
from typing import NamedTuple

LOG_FILTER = (
    "warn,zenoh::net::routing::interceptor=trace,zenoh::net::routing::interceptor::access_control=trace,"
    "zenoh_transport::unicast::establishment::accept=debug"
)
"""As the environment variable RUST_LOG has it."""

_LINKS_KEPT = 1024
_THREADS_KEPT = 256
_LONGEST = 1 << 16
"""Of a line: longer ones are no decision about a key."""

_COLOUR = re.compile(r"\x1b\[[0-9;]*m")
_LINE = re.compile(r"\S+\s+(?P<level>[A-Z]+)\s+(?:\S+ )?ThreadId\((?P<thread>\d+)\) (?P<target>[\w:]+): (?P<text>.*)")
_DENIED = re.compile(
    r"(?:Using cached result: )?(?P<link>[0-9a-f]+) (?:on (?P<subject>\S+) )?is unauthorized to "
    r"(?P<what>[A-Z].*?) \((?P<flow>ingress|egress)\) on (?P<key>.*)"
)
_WHO = re.compile(r"(?:CertCommonName|Username)\((?P<name>[^)]*)\)")
_HOW = re.compile(r"Transport\((?P<name>[^)]*)\)")
"""The protocol of a link, where nothing else is known of it."""

_DROPPED = "Msg intercepted!"
_TELLING = (b"unauthorized", b"intercepted!", b"WARN", b"ERROR", b"UsrPwd")
_TLS, _PASSWORD = "zenoh_link_tls::unicast", "UsrPwd extension - "
_NOISE = " Hint: increase the system open file limit."
"""Zenoh's hint on any link that it does not accept."""

_SOURCE = re.compile(r" at /\S+\.rs:\d+.*$")


class Refusal(NamedTuple):
    """Something that was not let through.

    Attributes:
        who: a certificate's common name or a process's, as far as it is known.
        what: ``put``, ``query``, …, or ``link``.
        key: the key expression, or why there is no link.
    """

    who: str
    what: str
    key: str


class Complaint(NamedTuple):
    """Anything else that Zenoh warns of."""

    text: str


class Reader:
    """Reads the log piece by piece."""

    def __init__(self) -> None:
        self._rest = b""
        self._denied: OrderedDict[str, re.Match[str]] = OrderedDict()
        self._names: OrderedDict[str, str] = OrderedDict()

    def read(self, piece: bytes) -> Iterator[Refusal | Complaint]:
        """What a piece of the log tells; its last line may go on in the next."""
        *lines, rest = (self._rest + piece).split(b"\n")
        self._rest = rest[:_LONGEST]
        for line in lines:
            if any(word in line for word in _TELLING) and (found := self._line(line)) is not None:
                yield found

    def name(self, link: str, name: str) -> None:
        """Tells whose a link is, by Zenoh's id of its other end."""
        self._names[link] = name
        self._names.move_to_end(link)
        while len(self._names) > _LINKS_KEPT:
            self._names.popitem(last=False)

    def _line(self, raw: bytes) -> Refusal | Complaint | None:
        line = _LINE.fullmatch(_COLOUR.sub("", raw.decode(errors="replace")).rstrip("\r"))
        if line is None:
            return None
        thread, text = line["thread"], line["text"]
        if denied := _DENIED.fullmatch(text):
            self._remember(thread, denied)
            return None
        return self._dropped(thread) if text == _DROPPED else _of_a_link(line["level"], line["target"], text)

    def _remember(self, thread: str, denied: re.Match[str]) -> None:
        """The last denial of a thread, and the name of a link, which only a link's first denials tell."""
        self._denied[thread] = denied
        while len(self._denied) > _THREADS_KEPT:
            self._denied.popitem(last=False)
        if denied["subject"] and (name := _WHO.search(denied["subject"]) or _HOW.search(denied["subject"])):
            self.name(denied["link"], name["name"])

    def _dropped(self, thread: str) -> Refusal | None:
        denied = self._denied.pop(thread, None)
        if denied is None or denied["flow"] != "ingress":
            return None
        return Refusal(self._names.get(denied["link"], ""), denied["what"].strip().lower(), denied["key"])


def _of_a_link(level: str, target: str, text: str) -> Refusal | Complaint | None:
    if text.startswith(_PASSWORD):
        return Refusal("", "link", _SOURCE.sub("", text.removeprefix(_PASSWORD)))
    if level not in ("WARN", "ERROR"):
        return None
    if target == _TLS:
        return Refusal("", "link", text.replace(_NOISE, ""))
    return Complaint(_SOURCE.sub("", text))
