"""Every message on the bus: pydantic models, each the type of one or more topics of ``common/topics.py``.

``stamp`` is integer nanoseconds since the Unix epoch, UTC, taken where the sensor fired. Metres, seconds, radians.
"""

from __future__ import annotations

import time
from enum import StrEnum
from typing import Annotated, Literal, Self

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, StringConstraints, model_validator

from common.arrays import (
    Actions,
    AnyArray,
    Covariance,
    Covariances,
    Descriptors,
    Image,
    Indices,
    Ranges,
    Transform,
    Transforms,
    Twist,
    Vector,
)
from common.camera import StereoCamera
from common.ids import MAP_ID_PATTERN, NAME_PATTERN, VertexId

_SIDE = (16, 16384)
"""Least and most pixels of an image's side, and columns of a scan."""
_SCAN_BOUNDS = (
    ("ranges", 0.0, 1000.0),
    ("intensities", 0.0, 65535.0),
    ("elevations", -1.5708, 1.5708),
    ("azimuths", -6.2832, 6.2832),
    ("offsets", -1.0, 1.0),
)
"""What a lidar can mean: metres, sensor's own levels, radians, seconds."""

Stamp = Annotated[int, Field(ge=0, lt=2**63)]
Name = Annotated[str, StringConstraints(pattern=NAME_PATTERN)]
MapId = Annotated[str, StringConstraints(pattern=MAP_ID_PATTERN)]
Text = Annotated[str, StringConstraints(max_length=2000)]
Count = Annotated[int, Field(ge=0, lt=2**31)]
Focal = Annotated[float, Field(gt=0, le=1e5)]
NotNegative = Annotated[float, Field(ge=0)]
Side = Annotated[int, Field(ge=_SIDE[0], le=_SIDE[1])]
Wavelength = Annotated[float, Field(ge=1e-7, le=2e-5)]


def now_ns() -> int:
    """The stamp of this moment."""
    return time.time_ns()


class Message(BaseModel):
    """Base of every message: immutable, nothing unknown in it, every number finite."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False, arbitrary_types_allowed=True)


# --- sensors ---------------------------------------------------------------------------------------------------------


class CameraModel(Message):
    """Calibration of a rectified stereo pair; see :class:`common.camera.StereoCamera`."""

    width: Side
    height: Side
    fx: Focal
    fy: Focal
    cx: Annotated[float, Field(ge=-1e5, le=1e5)]
    cy: Annotated[float, Field(ge=-1e5, le=1e5)]
    baseline: Annotated[float, Field(gt=0, le=100)]
    T_vehicle_camera: Transform
    wavelengths: tuple[Wavelength, Wavelength, Wavelength] | None = None
    transfer: Annotated[float, Field(ge=0.1, le=10)] | Literal["srgb"] = 1.0

    @model_validator(mode="after")
    def _colours_in_order(self) -> Self:
        if self.wavelengths is not None:
            red, green, blue = self.wavelengths
            if not min(red, blue) < green < max(red, blue):
                raise ValueError("the peak wavelength of green does not lie between those of red and blue")
        return self

    @classmethod
    def of(cls, camera: StereoCamera) -> Self:
        """The message of a camera."""
        return cls(**{name: getattr(camera, name) for name in cls.model_fields})

    def camera(self) -> StereoCamera:
        """The camera of this message."""
        return StereoCamera(**{name: getattr(self, name) for name in type(self).model_fields})


class StereoFrame(Message):
    """A rectified stereo pair, grey (H, W) or RGB (H, W, 3), uint8."""

    stamp: Stamp
    camera: CameraModel
    left: Image
    right: Image

    @model_validator(mode="after")
    def _images_fit(self) -> Self:
        size = (self.camera.height, self.camera.width)
        for image in (self.left, self.right):
            if image.shape not in (size, (*size, 3)):
                raise ValueError(f"an image is {image.shape}, its calibration {size}")
        if self.left.shape != self.right.shape:
            raise ValueError("one image is grey and the other is not")
        return self


class CameraFrame(Message):
    """An image of one camera of which nothing is known, grey (H, W) or RGB (H, W, 3), uint8."""

    stamp: Stamp
    image: Image

    @model_validator(mode="after")
    def _is_an_image(self) -> Self:
        shape = self.image.shape
        if len(shape) not in (2, 3) or shape[2:] not in ((), (3,)):
            raise ValueError(f"an array {shape} is no grey or RGB image")
        if not all(_SIDE[0] <= side <= _SIDE[1] for side in shape[:2]):
            raise ValueError(f"an image's sides have {_SIDE[0]} to {_SIDE[1]} pixels, not {shape[:2]}")
        return self


class LidarScan(Message):
    """One turn of a spinning lidar, organised: H beams from the top to the bottom, W columns in the order of firing.

    ``ranges`` (H, W) in metres are distances from the lidar's centre when the beam was fired, 0 where nothing came
    back; ``intensities`` (H, W) are as the sensor reports them: uint8, uint16, or float32 up to 65535. ``elevations``
    (H,) or (H, W) and ``azimuths`` (W,) or (H, W), positive to the left, are in the lidar's frame (x forward, y left,
    z up). Column j was fired ``offsets[j]`` seconds after the stamp, before it where that is negative.
    """

    stamp: Stamp
    T_vehicle_lidar: Transform
    ranges: Ranges
    intensities: AnyArray
    elevations: AnyArray
    azimuths: AnyArray
    offsets: Vector

    @model_validator(mode="after")
    def _is_a_scan(self) -> Self:
        beams, columns = self.ranges.shape
        if not 2 <= beams <= 512 or not _SIDE[0] <= columns <= _SIDE[1]:
            raise ValueError(f"a scan of {beams} beams and {columns} columns is of no spinning lidar")
        if self.intensities.shape != self.ranges.shape or self.offsets.shape != (columns,):
            raise ValueError("a scan has an intensity for every range and an offset for every column")
        if self.elevations.shape not in ((beams,), (beams, columns)):
            raise ValueError(f"elevations {self.elevations.shape} do not fit ranges {self.ranges.shape}")
        if self.azimuths.shape not in ((columns,), (beams, columns)):
            raise ValueError(f"azimuths {self.azimuths.shape} do not fit ranges {self.ranges.shape}")
        if self.intensities.dtype.str not in {"|u1", "<u2", "<f4"}:
            raise ValueError(f"intensities are uint8, uint16 or float32, not {self.intensities.dtype}")
        for name in ("elevations", "azimuths"):
            if getattr(self, name).dtype.str not in {"<f4", "<f8"}:
                raise ValueError(f"{name} are float32 or float64")
        return self

    @model_validator(mode="after")
    def _is_possible(self) -> Self:
        for name, least, most in _SCAN_BOUNDS:
            values = getattr(self, name)
            if values.min() < least or values.max() > most:
                raise ValueError(f"{name} are between {least:g} and {most:g}")
        return self


class WheelOdometry(Message):
    """Speed (m/s, forward) and turn rate (rad/s, to the left) as the wheels report them."""

    stamp: Stamp
    v: Annotated[float, Field(ge=-100, le=100)]
    w: Annotated[float, Field(ge=-100, le=100)]


class Joystick(Message):
    """Axes in [-1, 1], and whether the dead man's switch is held."""

    stamp: Stamp
    axes: Annotated[list[Annotated[float, Field(ge=-1, le=1)]], Field(max_length=16)]
    held: bool


class Truth(Message):
    """The synthetic world's truth, for tests and reports alone: pose, and the base's own speed."""

    stamp: Stamp
    T_world_vehicle: Transform
    v: float
    w: float


class Place(Message):
    """Puts the synthetic world's robot at a pose of the plane, at rest."""

    x: float
    y: float
    yaw: float


class WorldTime(Message):
    """Sets the synthetic world's clock, and so its sun, to the moment ``stamp``."""

    stamp: Stamp


# --- pose graph ------------------------------------------------------------------------------------------------------


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


class NamePlace(Message):
    """Names a vertex of an environment; naming another vertex moves the name."""

    environment: Name
    place: Name
    vertex: VertexId


class Done(Message):
    """An answer without content: it is done (and durable where that matters); ``text`` says what."""

    text: Text = ""


# --- estimation ------------------------------------------------------------------------------------------------------


class Odometry(Message):
    """Pose of the robot in the last vertex (or in the first frame, where there is no vertex yet).

    ``twist`` (6,) is in the vehicle frame; ``success`` is False where the motion is only predicted.
    """

    stamp: Stamp
    vertex: VertexId | None
    T_vertex_robot: Transform
    covariance: Covariance
    twist: Twist
    success: bool
    inliers: Count
    reason: Text = ""


class Localization(Message):
    """The localization chain's state after a frame.

    ``trunk`` is the route's vertex that the robot is nearest to and ``trunk_index`` its place in the route.
    ``T_trunk_robot`` is by localization where ``success``, else dead reckoning from the last one. ``streams`` says of
    each stream whether it localized; ``stream`` is the one that the estimate was taken from.

    Where not ``metric``, distance along the way and heading alone are measured: x of ``T_trunk_robot`` is the distance
    from the trunk, its yaw the heading, and y says nothing. ``actions`` (K, 3), in order, are what was taught around
    the robot, to be replayed: ``[metres ahead of the robot, m/s, rad/s]``.
    """

    stamp: Stamp
    route: Text
    trunk: VertexId
    trunk_index: Count
    T_trunk_robot: Transform
    covariance: Covariance
    success: bool
    stream: Name
    streams: Annotated[dict[Name, bool], Field(max_length=8)] = {}
    inliers: Count
    metres_since_success: NotNegative
    seconds_since_success: NotNegative
    reason: Text = ""
    metric: bool = True
    actions: Actions | None = None


class Relocalize(Message):
    """Asks where in an environment the robot stands, of which nothing is known."""

    environment: Name


class Relocalization(Message):
    """Answer to ``relocalize``: the vertex that the robot found itself at, taught if any is near, and its pose there.

    ``stamp`` is that of the frame, ``inliers`` the landmarks that agree, ``stream`` the images that they are of.
    """

    stamp: Stamp
    vertex: VertexId
    T_vertex_robot: Transform
    covariance: Covariance
    inliers: Count
    stream: Name


# --- planning and mission --------------------------------------------------------------------------------------------


class PlanRequest(Message):
    """From a vertex to a vertex (``map:index``), a map's end (its id), or a named place."""

    environment: Name
    start: VertexId
    goal: Text


class Route(Message):
    """Vertices to follow, their poses ``T_first_vertex`` (N, 4, 4) in the first one's frame, and why these."""

    id: Text
    environment: Name
    goal: Text
    vertices: list[VertexId]
    path: Transforms
    length: NotNegative
    maps: list[MapId]
    reason: Text

    @model_validator(mode="after")
    def _one_pose_a_vertex(self) -> Self:
        if len(self.vertices) != len(self.path) or not self.vertices:
            raise ValueError("a route has one pose for each of its vertices, and at least one")
        return self


class StateName(StrEnum):
    """The navigator's states (VT&R3); ``Paused`` keeps what was being done."""

    IDLE = "Idle"
    TEACH_METRIC_LOCALIZE = "Teach.MetricLocalize"
    TEACH_BRANCH = "Teach.Branch"
    REPEAT_PLAN = "Repeat.Plan"
    REPEAT_METRIC_LOCALIZE = "Repeat.MetricLocalize"
    REPEAT_FOLLOW = "Repeat.Follow"
    PAUSED = "Paused"


class State(Message):
    """What the robot is doing, why, and what it waits for; published on change and ten times a second.

    ``map`` is the map being taught, or recorded while a route is repeated; ``route`` the id of the route being
    followed; ``target`` the vertex to localize against; ``position`` the vertex last localized against; ``resumes``
    the state behind a pause.
    """

    stamp: Stamp
    name: StateName
    environment: Name
    since: Stamp
    reason: Text
    waiting_for: Text = ""
    resumes: StateName | None = None
    map: MapRecord | None = None
    route: Text = ""
    target: VertexId | None = None
    position: VertexId | None = None
    goal: Text = ""


class Command(Message):
    """An operator's command to the navigator.

    ``teach`` starts a map (from ``vertex`` if the environment has maps) and ``finish`` ends it, naming its ends
    ``start_place`` and ``end_place`` where given; ``repeat`` drives to ``goal``, and ``record`` says whether an
    experience is recorded on the way (None: as the robot is configured); ``position`` tells the robot which vertex it
    stands at or, with ``find``, has it look for itself.
    """

    action: Literal["teach", "finish", "repeat", "pause", "resume", "cancel", "position"]
    environment: Name | None = None
    goal: Text = ""
    vertex: VertexId | None = None
    start_place: Name | None = None
    end_place: Name | None = None
    record: bool | None = None
    find: bool = False


class SafetyCommand(Message):
    """An operator's command to safety itself: an emergency stop, or its reset, which starts no motion."""

    action: Literal["stop", "reset"]
    reason: Text = ""


# --- control ---------------------------------------------------------------------------------------------------------


class VelocityCommand(Message):
    """Speed (m/s) and turn rate (rad/s). ``frame_stamp`` is that of the frame which it follows from, 0 for none."""

    stamp: Stamp
    v: float
    w: float
    frame_stamp: Stamp = 0


class TrackerStatus(Message):
    """The tracker's view of the route: errors, arc length and what remains, metres and radians."""

    stamp: Stamp
    route: Text
    lateral_error: float
    heading_error: float
    arclength: float
    remaining: float
    speed_limit: float
    finished: bool
    reason: Text = ""


class StopReason(Message):
    """A rule that holds the robot back: its name, and one sentence with the figure and the limit."""

    rule: Name
    text: Text


class SafetyStatus(Message):
    """Whether commands pass, how much of their speed, and every reason against."""

    stamp: Stamp
    passing: bool
    scale: Annotated[float, Field(ge=0, le=1)]
    latched: bool
    reasons: list[StopReason]


# --- health ----------------------------------------------------------------------------------------------------------


class Percentiles(Message):
    """Durations of one stage, milliseconds, over its last thousand runs; ``count`` is that of all runs."""

    count: Count
    p50: NotNegative
    p99: NotNegative


class Health(Message):
    """A process in figures, once a second: rates (Hz) by topic, stages' durations, CPU (fraction of a core), memory."""

    stamp: Stamp
    process: Name
    pid: Count
    started: Stamp
    cpu: NotNegative
    memory_mb: NotNegative
    rates: dict[str, NotNegative]
    dropped: dict[str, Count]
    stages: dict[str, Percentiles]


def covariance_of(variances: tuple[float, ...] | list[float]) -> Covariance:
    """A diagonal covariance (6, 6) of variances in m^2 and rad^2."""
    return np.diag(np.asarray(variances, dtype=np.float64))
