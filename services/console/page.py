"""What a page of the console is: its files, what it shows, and what it does when a browser asks."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

from common.service import Service
from services.console.channel import Channel
from services.console.errors import UnknownAction
from services.console.settings import Settings


@dataclass(frozen=True, slots=True)
class Resource:
    """Bytes that a page hands out, and their media type."""

    body: bytes
    kind: str


class Page(ABC):
    """One page; shared by all browsers that look at it.

    Its files are in the folder ``static`` beside its module and are served below ``/static/<name>/``: ``page.html``
    (put into the common frame), ``page.js`` (a module that the frame loads) and ``page.css``.

    Attributes:
        name: in its address, ``/<name>``.
        title: in the navigation.
        folder: of its files.
        channel: what it shows.
    """

    name: ClassVar[str]
    title: ClassVar[str]
    folder: ClassVar[Path]

    def __init__(self, service: Service, settings: Settings) -> None:
        self.service = service
        self.settings = settings
        self.channel = Channel()

    @abstractmethod
    def update(self, now: float) -> None:
        """Reads the bus's subscriptions and fills the channel, in the console's own thread.

        Called ten times a second, and twenty times while somebody looks. It must not wait; ``now`` is
        monotonic, in seconds.
        """

    def act(self, action: str, arguments: Mapping[str, Any]) -> object:  # noqa: ARG002, for those who have actions
        """Carries out what a browser asks, in a thread that may wait for an answer of the bus.

        Returns what the browser is told: a sentence, or anything that JSON has.

        Raises:
            RetraverseError: it is refused, and why.
        """
        raise UnknownAction(f"the page '{self.name}' knows no '{action}'")

    def hear(self, browser: int, message: Mapping[str, Any]) -> None:  # noqa: B027, most have nothing to hear
        """Takes a message that wants no answer, such as the joystick's; in the server's thread, so at once.

        ``browser`` is the number of the connection.
        """

    def left(self, browser: int) -> None:  # noqa: B027, most do not mind
        """A browser's connection has ended."""

    def resource(self, path: str) -> Resource | None:  # noqa: ARG002, for those who have some
        """What is served at ``/data/<name>/<path>``; None where there is nothing. In a thread of its own."""
        return None

    def store(self, path: str, body: bytes) -> object:  # noqa: ARG002, for those who take some
        """Takes what was uploaded to ``/data/<name>/<path>``.

        Raises:
            RetraverseError: it is refused, and why.
        """
        raise UnknownAction(f"the page '{self.name}' takes nothing at '{path}'")
