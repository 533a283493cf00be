"""What a page shows, once for all of its browsers: each gets all of it when it comes, and then what changes."""

from __future__ import annotations

import json
import threading
from collections import deque
from dataclasses import dataclass, field
from typing import Any

_STREAM_KEPT = 600


def encode(value: object) -> str:
    """Compact JSON.

    Raises:
        ValueError: it holds a number that is not finite.
    """
    return json.dumps(value, separators=(",", ":"), allow_nan=False, ensure_ascii=False)


@dataclass(slots=True)
class _Section:
    """A value as JSON, None once it is dropped, and the revision that changed it."""

    text: str | None
    revision: int


@dataclass(slots=True)
class _Stream:
    """The last values of a series as JSON, each with the revision that brought it."""

    values: deque[tuple[int, str]] = field(default_factory=lambda: deque(maxlen=_STREAM_KEPT))


@dataclass(frozen=True, slots=True)
class Picture:
    """An image as a browser takes it: a header, the bytes of a JPEG, and its number."""

    number: int
    payload: bytes


class Channel:
    """The sections and series of a page by name, written by one thread and read by another.

    A reader knows a revision, and :meth:`since` tells what came after it. So a reader that is behind is told the newest
    of everything, and none is kept waiting or remembered. What was said once is encoded once, whoever asks.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._revision = 1
        self._sections: dict[str, _Section] = {}
        self._streams: dict[str, _Stream] = {}
        self._told: dict[int, str] = {}
        self._pictures: dict[str, Picture] = {}
        self.watchers = 0
        """How many browsers look at the page now; the server counts."""

    def set(self, key: str, value: object) -> None:
        """Shows a value, anything that JSON has; nothing is told where it is what was shown before."""
        text = encode(value)
        with self._lock:
            section = self._sections.get(key)
            if section is None or section.text != text:
                self._sections[key] = _Section(text, self._advance())

    def drop(self, key: str) -> None:
        """Shows a value no more."""
        with self._lock:
            section = self._sections.get(key)
            if section is not None and section.text is not None:
                self._sections[key] = _Section(None, self._advance())

    def append(self, key: str, value: object) -> None:
        """Adds a value to a series, of which the last 600 are kept for those who come later."""
        text = encode(value)
        with self._lock:
            self._streams.setdefault(key, _Stream()).values.append((self._advance(), text))

    def keys(self, prefix: str = "") -> list[str]:
        """The names of the sections that begin so."""
        with self._lock:
            return [key for key, one in self._sections.items() if one.text is not None and key.startswith(prefix)]

    def since(self, revision: int) -> tuple[int, str | None]:
        """The present revision, and what came after another one as a JSON text; None where nothing did.

        After revision 0 that is everything.
        """
        with self._lock:
            if revision not in self._told:
                self._told[revision] = self._tell(revision)
            text = self._told[revision] if revision < self._revision else None
            return self._revision, text

    def show(self, name: str, jpeg: bytes, header: dict[str, Any]) -> None:
        """Shows an image in place of the last one of that name; ``header`` says what is drawn over it."""
        about = encode({"name": name, **header}).encode()
        payload = len(about).to_bytes(4, "little") + about + jpeg
        with self._lock:
            before = self._pictures.get(name)
            self._pictures[name] = Picture(1 if before is None else before.number + 1, payload)

    def pictures(self) -> dict[str, Picture]:
        """The newest image of each name."""
        with self._lock:
            return dict(self._pictures)

    def _advance(self) -> int:
        self._revision += 1
        self._told.clear()
        return self._revision

    def _tell(self, revision: int) -> str:
        changed = {key: one for key, one in self._sections.items() if one.revision > revision}
        parts = []
        if revision == 0:
            parts.append('"all":true')
        if values := [f"{encode(key)}:{one.text}" for key, one in changed.items() if one.text is not None]:
            parts.append(f'"set":{{{",".join(values)}}}')
        dropped = [key for key, one in changed.items() if one.text is None]
        if dropped and revision > 0:
            parts.append(f'"drop":{encode(dropped)}')
        added = []
        for key, stream in self._streams.items():
            if texts := [text for number, text in stream.values if number > revision]:
                added.append(f"{encode(key)}:[{','.join(texts)}]")
        if added:
            parts.append(f'"add":{{{",".join(added)}}}')
        return f"{{{','.join(parts)}}}"
