"""What is known of a shared map without fetching it (section 3.1.1 of the thesis), and where it is stored.

One small immutable JSON object a map, in the bucket of environments; writing it is the commit of an upload. Everything
that a robot writes is below its own prefix, so that its rights may end there:

```
bucket maps          robots/<robot>/<environment>/<map>.zip          the archive
bucket environments  robots/<robot>/<environment>/maps/<map>.json    this metadata
                     robots/<robot>/<environment>/reports/<id>.json  how a repeat went
                     derived/<environment>/...                       what the server makes of them, and can make again
```
"""

from __future__ import annotations

import base64
from datetime import UTC, datetime
from typing import Annotated, Final, Literal, Self

import numpy as np
from pydantic import Base64Bytes, BaseModel, ConfigDict, Field, StringConstraints, model_validator

from common.environment.model import MapEntry
from common.errors import ImageError
from common.ids import MAP_ID_PATTERN, NAME_PATTERN, PLACE_PATTERN
from common.registration import Described

SCHEMA: Final = 1
"""Version of the metadata; a reader refuses newer ones."""

SUFFIX = ".json"

_LEAST, _MOST = 1e-12, 1e9

Name = Annotated[str, StringConstraints(pattern=NAME_PATTERN)]
MapId = Annotated[str, StringConstraints(pattern=MAP_ID_PATTERN)]
PlaceName = Annotated[str, StringConstraints(pattern=PLACE_PATTERN)]
Metres = Annotated[float, Field(ge=0, le=_MOST)]
Seconds = Annotated[float, Field(ge=0, le=_MOST)]
Rate = Annotated[float, Field(ge=-1000, le=1000)]


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class Archive(_Strict):
    """The stored archive: its size and its SHA-256 sum, in hexadecimal digits."""

    bytes: Annotated[int, Field(gt=0, lt=2**40)]
    sha256: Annotated[str, StringConstraints(pattern=r"^[0-9a-f]{64}$")]


class ImageAlong(_Strict):
    """An image of the map, ``distance`` m from its start, as :class:`common.registration.Described`.

    ``values`` are int8 of the shape ``(c, h, w)``, to be multiplied by ``scale``.
    """

    distance: Metres
    shape: tuple[Annotated[int, Field(gt=0, le=4096)], Annotated[int, Field(gt=0, le=4096)],
                 Annotated[int, Field(gt=0, le=4096)]]  # fmt: skip
    values: Annotated[Base64Bytes, Field(max_length=2_000_000)]
    width: Annotated[float, Field(gt=0, le=1e5)]
    height: Annotated[float, Field(gt=0, le=1e5)]
    cell_height: Annotated[float, Field(gt=0, le=1e5)]
    scale: Annotated[float, Field(ge=_LEAST, le=_MOST)]
    name: Annotated[str, StringConstraints(min_length=1, max_length=64)]

    @model_validator(mode="after")
    def _whole(self) -> Self:
        if len(self.values) != self.shape[0] * self.shape[1] * self.shape[2]:
            raise ValueError(f"an image's representation has {len(self.values)} values, its shape is {self.shape}")
        return self

    @classmethod
    def of(cls, distance: float, image: Described) -> Self:
        """The stored form of a representation."""
        arrays = image.to_arrays()
        width, height, cell_height, scale = map(float, arrays["geometry"])
        c, h, w = arrays["values"].shape
        return cls(
            distance=distance,
            shape=(c, h, w),
            values=base64.b64encode(arrays["values"].tobytes()),
            width=width,
            height=height,
            cell_height=cell_height,
            scale=scale,
            name=image.name,
        )

    def described(self) -> Described:
        """The representation again.

        Raises:
            ImageError: it holds none.
        """
        values = np.frombuffer(self.values, dtype=np.int8).reshape(self.shape)
        arrays = {
            "values": values,
            "geometry": np.array([self.width, self.height, self.cell_height, self.scale]),
            "name": np.frombuffer(self.name.encode(), dtype=np.uint8),
        }
        if not values.any():
            raise ImageError("an image's representation is empty")
        return Described.from_arrays(arrays)


class MapMetadata(_Strict):
    """All that plans, similarities and a fetching robot need of a map.

    Attributes:
        name: the map's id, unique in the fleet.
        timestamp: when it was begun, UTC.
        length: metres driven, along its temporal edges.
        start, end: the places that it leads from and to; None for a repeat that leads nowhere a plan could use.
        vertices: how many it has; ``times`` (s) and ``distances`` (m) since its start have one value for each.
        actions: (time s, distance m, speed m/s, turn rate rad/s) as they were commanded, or as they were driven where
            no commands were recorded.
        images: representations of a few images, evenly along the map.
    """

    version: Literal[1] = SCHEMA
    name: MapId
    environment: Name
    robot: Name
    sensor: Name
    timestamp: datetime
    length: Metres
    start: PlaceName | None = None
    end: PlaceName | None = None
    generation: Annotated[int, Field(ge=0, lt=2**31)] = 0
    parent: MapId | None = None
    vertices: Annotated[int, Field(gt=0, lt=2**31)]
    times: Annotated[list[Seconds], Field(max_length=1_000_000)]
    distances: Annotated[list[Metres], Field(max_length=1_000_000)]
    actions: Annotated[list[tuple[Seconds, Metres, Rate, Rate]], Field(max_length=1_000_000)] = []
    images: Annotated[list[ImageAlong], Field(max_length=16)] = []
    archive: Archive

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        if not self.vertices == len(self.times) == len(self.distances):
            raise ValueError("a map has one time and one distance for each of its vertices")
        if self.timestamp.tzinfo is None:
            raise ValueError("a timestamp without an offset is ambiguous: write it in UTC")
        return self

    def entry(self) -> MapEntry | None:
        """The map as an edge between two places; None where it leads nowhere a plan could use."""
        if self.start is None or self.end is None:
            return None
        return MapEntry(
            name=self.name,
            start=self.start,
            end=self.end,
            timestamp=self.timestamp,
            length=self.length,
            generation=self.generation,
        )


def time_of(stamp_ns: int) -> datetime:
    """The UTC time of a stamp, to the microsecond."""
    return datetime.fromtimestamp(stamp_ns // 1000 / 1e6, tz=UTC)


def robot_of(map_id: str) -> str:
    """The robot that a map id names: ``20261122T204500123456-r1-9f3c1a`` is one of r1's."""
    return map_id.partition("-")[2].rpartition("-")[0]


def prefix(robot: str) -> str:
    """Below this a robot may write, in either bucket."""
    return f"robots/{robot}/"


def archive_key(environment: str, map_id: str) -> str:
    """The archive of a map, in the bucket of maps."""
    return f"{prefix(robot_of(map_id))}{environment}/{map_id}.zip"


def metadata_key(environment: str, map_id: str) -> str:
    """The metadata of a map, in the bucket of environments."""
    return f"{prefix(robot_of(map_id))}{environment}/maps/{map_id}{SUFFIX}"


def report_key(robot: str, environment: str, report: str) -> str:
    """A repeat's report (:class:`common.messages.RepeatReport` as JSON), in the bucket of environments."""
    return f"{prefix(robot)}{environment}/reports/{report}{SUFFIX}"


def derived_key(environment: str, name: str) -> str:
    """What the server made of an environment, in the bucket of environments."""
    return f"derived/{environment}/{name}"
