"""Names that are unique across a fleet without asking anybody."""

from __future__ import annotations

import re
import secrets
from datetime import UTC, datetime
from typing import Annotated, NamedTuple, Self

from pydantic import Field

NAME_PATTERN = r"^[a-z0-9][a-z0-9_-]{0,62}$"
"""Robots, environments, sensors and places: safe in a key expression, a file name and an object key."""

MAP_ID_PATTERN = r"^\d{8}T\d{12}-[a-z0-9][a-z0-9_-]{0,62}-[0-9a-f]{6}$"

PLACE_PATTERN = rf"^(?:{NAME_PATTERN[1:-1]}|{MAP_ID_PATTERN[1:-1]}:\d{{1,9}})$"
"""A place: a name, or the vertex (``map:index``) of an end that nobody has named."""

_VERTEX = re.compile(r"(?P<map>[^:]+):(?P<index>[0-9]{1,9})")


def new_map_id(robot: str, stamp_ns: int) -> str:
    """A map id that sorts by time and names its robot: ``20261122T204500123456-r1-9f3c1a``.

    The random part keeps two maps apart when the robot's clock has been set back.
    """
    time = datetime.fromtimestamp(stamp_ns // 1000 / 1e6, tz=UTC)
    return f"{time:%Y%m%dT%H%M%S%f}-{robot}-{secrets.token_hex(3)}"


def is_name(text: str) -> bool:
    """Whether a text is a name, as against a vertex that stands for a place without one."""
    return re.fullmatch(NAME_PATTERN, text) is not None


class VertexId(NamedTuple):
    """A vertex: the map (experience) that it belongs to and its index there, in driving order."""

    map_id: Annotated[str, Field(max_length=100)]
    index: Annotated[int, Field(ge=0, lt=2**31)]  # type: ignore[assignment]  # hides tuple.index, of no use here

    def __str__(self) -> str:
        return f"{self.map_id}:{self.index}"

    @classmethod
    def parse(cls, text: str) -> Self:
        """The id written as ``map:index``.

        Raises:
            ValueError: the text is not of that form.
        """
        match = _VERTEX.fullmatch(text)
        if match is None:
            raise ValueError(f"'{text}' is not a vertex: write it as map:index")
        return cls(match["map"], int(match["index"]))
