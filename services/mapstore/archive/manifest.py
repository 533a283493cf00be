"""What an archive says of itself: whose map it is, and the size and SHA-256 sum of each of its members."""

from __future__ import annotations

from typing import Annotated, Final, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, StringConstraints, model_validator

from common.messages import Count, EdgeRecord, MapEnds, MapRecord, Message, PlaceName

NAME: Final = "manifest.json"
FORMAT: Final = 1
"""Version of the archive; a reader refuses newer ones."""

EDGES_A_MEMBER: Final = 64
LARGEST_MEMBER: Final = 64 * 1024 * 1024
"""Bytes of a vertex, or of a few edges; a vertex has some 0.15 MB."""

MOST_MEMBERS: Final = 400_000
"""200 km of vertices, half a metre apart."""

LARGEST_MANIFEST: Final = 1000 + 256 * MOST_MEMBERS
"""Bytes."""


class Member(BaseModel):
    """A file within the archive."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    name: Annotated[str, StringConstraints(pattern=r"^(vertices|edges)/\d{6}\.bin$")]
    bytes: Annotated[int, Field(gt=0, le=LARGEST_MEMBER)]
    sha256: Annotated[str, StringConstraints(pattern=r"^[0-9a-f]{64}$")]


class Manifest(BaseModel):
    """``manifest.json``."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    format: Literal[1] = FORMAT
    map: MapRecord
    start_place: PlaceName | None = None
    end_place: PlaceName | None = None
    vertices: Annotated[Count, Field(gt=0)]
    edges: Count
    members: Annotated[list[Member], Field(max_length=MOST_MEMBERS)]

    @model_validator(mode="after")
    def _members_follow(self) -> Self:
        chunks = -(-self.edges // EDGES_A_MEMBER)
        # Of the members that are there, not of those that are promised: a few digits may promise billions.
        if len(self.members) != self.vertices + chunks:
            raise ValueError("its members are not one for each vertex and then those of its edges")
        expected = [vertex_name(k) for k in range(self.vertices)] + [edges_name(k) for k in range(chunks)]
        if [member.name for member in self.members] != expected:
            raise ValueError("its members are not one for each vertex and then those of its edges")
        return self

    def ends(self) -> MapEnds:
        """The places that the map leads from and to."""
        return MapEnds(map=self.map.id, start_place=self.start_place, end_place=self.end_place)


class Edges(Message):
    """A member with edges."""

    edges: Annotated[list[EdgeRecord], Field(max_length=EDGES_A_MEMBER)]


def vertex_name(index: int) -> str:
    """The member of a vertex."""
    return f"vertices/{index:06d}.bin"


def edges_name(index: int) -> str:
    """The member of a few edges."""
    return f"edges/{index:06d}.bin"
