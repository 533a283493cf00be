"""The pose graph as it is committed, kept and asked for."""

from __future__ import annotations

from enum import StrEnum
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from common.arrays import AnyArray, Covariance, Covariances, Descriptors, Indices, Transform, Transforms
from common.ids import VertexId
from common.messages.base import Count, MapId, Message, Name, NotNegative, PlaceName, Stamp, Text
from common.messages.sensors import CameraModel


class MapRecord(Message):
    """An experience: one drive, taught or repeated.

    ``generation`` is 0 for a taught map and one more than its parent's for a map recorded in a repeat.
    """

    id: MapId
    environment: Name
    stamp: Stamp
    robot: Name
    sensor: Name
    generation: Count = 0
    parent: MapId | None = None


class Keyframe(Message):
    """What a vertex keeps of its sensor: named arrays of the pipeline that made them, and a picture.

    ``appearance`` holds, by stream, the few descriptors by which the place is recognised among all others. The map
    store keeps it apart: it is asked for by ``graph/appearance``, and ``graph/submap`` answers without it.
    """

    pipeline: Name
    camera: CameraModel | None = None
    arrays: Annotated[dict[str, AnyArray], Field(max_length=64)]
    thumbnail: Annotated[bytes, Field(max_length=200_000)] = b""
    appearance: Annotated[dict[Name, Descriptors], Field(max_length=8)] = {}


class VertexRecord(Message):
    """A vertex: its id, the stamp of the frame that it was made of, and its keyframe."""

    id: VertexId
    stamp: Stamp
    keyframe: Keyframe


class EdgeRecord(Message):
    """``T_a_b`` between two vertices: temporal by odometry, spatial by localization."""

    kind: Literal["temporal", "spatial"]
    a: VertexId
    b: VertexId
    T_a_b: Transform
    covariance: Covariance


class Commit(Message):
    """Parts of the graph that become durable together or not at all; sending it again changes nothing."""

    map: MapRecord | None = None
    vertex: VertexRecord | None = None
    edges: Annotated[list[EdgeRecord], Field(max_length=64)] = []
    finished: MapId | None = None


class MapEnds(Message):
    """The places that a finished map leads from and to, told once: then it is whole, and may be shared.

    None where an end has no name: a taught map's then is its vertex, and a repeat that began or ended on the way leads
    nowhere that a plan could use.
    """

    map: MapId
    start_place: PlaceName | None = None
    end_place: PlaceName | None = None


class SyncState(StrEnum):
    """How far a map is shared.

    ``Local`` is not to be uploaded, or not yet; ``Waiting`` and ``Uploading`` are under way; ``Synced`` is in the
    fleet's storage and here; ``Fetched`` came from there; ``Quarantined`` cannot be shared, with a reason.
    """

    LOCAL = "Local"
    WAITING = "Waiting"
    UPLOADING = "Uploading"
    SYNCED = "Synced"
    FETCHED = "Fetched"
    QUARANTINED = "Quarantined"


class GraphQuery(Message):
    """Which part of the graph: an environment's (None: every one), or named vertices or a map."""

    environment: Name | None = None
    map: MapId | None = None
    vertices: Annotated[list[VertexId], Field(max_length=256)] = []


class MapSummary(Message):
    """A stored map in figures; ``length`` is that of its temporal edges in metres."""

    record: MapRecord
    vertices: Count
    length: NotNegative
    bytes: Count
    finished: bool
    start_place: PlaceName | None = None
    end_place: PlaceName | None = None
    sync: SyncState = SyncState.LOCAL


class MapList(Message):
    """Answer to ``graph/maps``: oldest first."""

    maps: list[MapSummary]


class Submap(Message):
    """Answer to ``graph/submap``: the vertices asked for, in that order, with their keyframes."""

    vertices: list[VertexRecord]


class AppearanceQuery(Message):
    """The appearance of an environment's vertices, but for the first ``known[map]`` of each map."""

    environment: Name
    known: Annotated[dict[MapId, Count], Field(max_length=100_000)] = {}


class Appearances(Message):
    """Answer to ``graph/appearance``: N vertices of an environment and, by stream, the descriptors of each.

    ``maps`` are all of the environment's, oldest first. Row j of ``vertices`` (N, 2) is ``[k, i]``: vertex i of map k,
    with ``counts[stream][j]`` descriptors; ``descriptors[stream]`` holds them one vertex after the other. Where
    ``more``, the answer is one page, and the next is asked for with these vertices known.
    """

    maps: list[MapRecord]
    vertices: Indices
    counts: dict[Name, Indices]
    descriptors: dict[Name, Descriptors]
    more: bool

    @model_validator(mode="after")
    def _arrays_fit(self) -> Self:
        count = len(self.vertices)
        if self.vertices.shape != (count, 2) or self.counts.keys() != self.descriptors.keys():
            raise ValueError("the arrays of the appearances do not belong together")
        if ((self.vertices < 0) | (self.vertices >= [len(self.maps), 2**31 - 1])).any():
            raise ValueError("an appearance is of a vertex that no map has")
        for stream, counts in self.counts.items():
            if counts.shape != (count,) or (counts < 0).any() or int(counts.sum()) != len(self.descriptors[stream]):
                raise ValueError(f"the counts of stream {stream} do not fit its descriptors")
        return self


class Restriction(Message):
    """A stretch of a map on which the robot drives no faster than ``speed`` (m/s), or not at all where that is 0.

    It goes from vertex ``first`` to vertex ``last``, both included. ``speed`` None lifts what was restricted on the
    stretch; ``reason`` is the operator's.
    """

    map: MapId
    first: Count
    last: Count
    speed: NotNegative | None = 0.0
    reason: Text = ""

    @model_validator(mode="after")
    def _in_order(self) -> Self:
        if self.last < self.first:
            raise ValueError("a stretch goes from its first vertex to its last one")
        return self


class Topology(Message):
    """Answer to ``graph/topology``: an environment's whole graph without keyframes.

    Vertex ``i`` of map ``k`` is named ``(k, i)`` in ``edges`` (M, 4), rows ``[k_a, i_a, k_b, i_b]``;
    ``T_a_b`` (M, 4, 4) and ``covariances`` (M, 6, 6) belong to them; ``spatial`` (M,) is 1 for a spatial edge.
    """

    environment: Name
    maps: list[MapSummary]
    edges: Indices
    spatial: AnyArray
    T_a_b: Transforms
    covariances: Covariances
    places: dict[Name, VertexId]
    restrictions: list[Restriction] = []


class NamePlace(Message):
    """Names a vertex of an environment; naming another vertex moves the name."""

    environment: Name
    place: Name
    vertex: VertexId


class Done(Message):
    """An answer without content: it is done (and durable where that matters); ``text`` says what."""

    text: Text = ""
