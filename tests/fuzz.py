"""Samples that no receiver may accept, for every topic: what a broken, old or hostile sender could put on the bus."""

from __future__ import annotations

import random
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import msgpack
import numpy as np
from numpy.typing import NDArray

from common import messages as m
from common import topics, wire
from common.bus.envelope import Envelope, Source
from common.errors import MalformedMessage
from common.ids import VertexId
from common.topics import Delivery, Topic

STAMP = 1_700_000_000_000_000_000
MAP_ID = "20261122T204500123456-r1-9f3c1a"

_HUGE = (2**31, 2**63 - 1, 2**63, 2**64 - 1, -(2**63), -1, 1e308, -1e308, float("inf"), float("nan"), 5e-324)


@dataclass(frozen=True, slots=True)
class Sample:
    """A payload with its attachment (None: it carries none), and in a word what is wrong with it."""

    payload: bytes
    attachment: bytes | None
    kind: str


def valid_examples() -> dict[Topic, m.Message]:
    """A valid message, or question, of every topic."""
    vertex, command = VertexId(MAP_ID, 3), m.VelocityCommand(stamp=STAMP, v=0.5, w=-0.1, frame_stamp=STAMP)
    edge = m.EdgeRecord(kind="temporal", a=VertexId(MAP_ID, 2), b=vertex, T_a_b=np.eye(4), covariance=np.eye(6) * 1e-4)
    part = m.GraphQuery(environment="park", map=MAP_ID, vertices=[vertex])
    return {
        topics.STEREO: m.StereoFrame(stamp=STAMP, camera=_camera(), left=_image(), right=_image()),
        topics.CAMERA: m.CameraFrame(stamp=STAMP, image=_image()),
        topics.LIDAR: _scan(),
        topics.LOOP_CLOSURE: m.LoopClosure(stamp=STAMP, edge=edge, inliers=40),
        topics.OBSTACLES: m.Obstacles(stamp=STAMP, ahead=m.Zone.SLOW, behind=m.Zone.CLEAR, nearest=2.0),
        topics.WHEEL_ODOMETRY: m.WheelOdometry(stamp=STAMP, v=1.0, w=0.1),
        topics.JOYSTICK: m.Joystick(stamp=STAMP, axes=[0.0, -1.0], held=True),
        topics.ODOMETRY: m.Odometry(
            stamp=STAMP, vertex=vertex, T_vertex_robot=np.eye(4), covariance=np.eye(6), twist=np.zeros(6),
            success=True, inliers=120,
        ),
        topics.LOCALIZATION: m.Localization(
            stamp=STAMP, route="r", trunk=vertex, trunk_index=3, T_trunk_robot=np.eye(4), covariance=np.eye(6),
            success=True, stream="plain", inliers=80, metres_since_success=0.0, seconds_since_success=0.0,
            actions=np.array([[0.0, 0.5, -0.1]]),
        ),
        topics.MATCHES: m.Matches(stamp=STAMP, stream="plain", success=True, pixels=np.ones((4, 2), np.float32)),
        topics.COMMIT: m.Commit(map=_map(), vertex=_vertex(vertex), edges=[edge], finished=MAP_ID),
        topics.MAPS: part, topics.TOPOLOGY: part, topics.SUBMAP: part, topics.REMOVE: part,
        topics.APPEARANCE: m.AppearanceQuery(environment="park", known={MAP_ID: 2}),
        topics.RELOCALIZE: m.Relocalize(environment="park"),
        topics.NAME_PLACE: m.NamePlace(environment="park", place="gate", vertex=vertex),
        topics.PLAN: m.PlanRequest(environment="park", start=vertex, goal="gate"),
        topics.RESTRICT: m.Restriction(map=MAP_ID, first=1, last=3),
        topics.ENDS: m.MapEnds(map=MAP_ID, start_place="gate"),
        topics.FETCH: m.FetchRequest(environment="park", maps=[MAP_ID]),
        topics.PUSH: m.PushRequest(maps=[MAP_ID]),
        topics.REPORT: m.RepeatReport(
            id="r", robot="r1", environment="park", stamp=STAMP, maps=[m.MapReport(map=MAP_ID, metres=9.0, lost=1.0)]
        ),
        topics.SYNC_STATUS: m.SyncStatus(stamp=STAMP, online=False, reason="no storage is configured"),
        topics.ROUTE: _route(vertex),
        topics.MISSION: m.Command(action="repeat", environment="park", goal=m.Goal(to="gate"), vertex=vertex),
        topics.STATE: m.State(
            stamp=STAMP, name=m.StateName.REPEAT_FOLLOW, environment="park", since=STAMP, reason="a route",
            map=_map(), route="r", target=vertex, position=vertex, goal="gate",
        ),
        topics.DESIRED: command, topics.TELEOP: command, topics.SAFE: command,
        topics.TRACKER_STATUS: m.TrackerStatus(
            stamp=STAMP, route="r", lateral_error=0.01, heading_error=0.0, arclength=3.0, remaining=9.0,
            speed_limit=1.0, finished=False,
        ),
        topics.SAFETY_STATUS: m.SafetyStatus(
            stamp=STAMP, passing=False, scale=0.0, latched=True, reasons=[m.StopReason(rule="latch", text="stopped")]
        ),
        topics.SAFETY_COMMAND: m.SafetyCommand(action="reset"),
        topics.HEALTH: m.Health(
            stamp=STAMP, process="tracker", pid=1, started=STAMP, cpu=0.1, memory_mb=80.0, rates={"state": 10.0},
            dropped={"state": 1}, stages={"solve": m.Percentiles(count=3, p50=1.0, p99=2.0)},
        ),
        topics.TRUTH: m.Truth(stamp=STAMP, T_world_vehicle=np.eye(4), v=1.0, w=0.0),
        topics.TRUTH_PLACE: m.Place(x=1.0, y=2.0, yaw=0.5),
        topics.TRUTH_TIME: m.WorldTime(stamp=STAMP),
    }  # fmt: skip


def valid_answers() -> dict[Topic, m.Message]:
    """A valid answer of every query."""
    vertex = VertexId(MAP_ID, 3)
    summary = m.MapSummary(record=_map(), vertices=4, length=12.5, bytes=1000, finished=True)
    topology = m.Topology(
        environment="park", maps=[summary], edges=np.zeros((1, 4), np.int32), spatial=np.zeros(1, np.uint8),
        T_a_b=np.eye(4)[None], covariances=np.eye(6)[None], places={"gate": vertex},
    )  # fmt: skip
    special = {
        topics.MAPS: m.MapList(maps=[summary]),
        topics.TOPOLOGY: topology,
        topics.SUBMAP: m.Submap(vertices=[_vertex(vertex)]),
        topics.APPEARANCE: _appearances(),
        topics.RELOCALIZE: m.Relocalization(
            stamp=STAMP, vertex=vertex, T_vertex_robot=np.eye(4), covariance=np.eye(6), inliers=90, stream="plain"
        ),
        topics.PLAN: _route(vertex),
    }
    return {t: special.get(t, m.Done(text="done")) for t in topics.ALL if t.delivery is Delivery.QUERY}


def samples(
    topic: Topic, robot: str, count: int, seed: int = 0, recorded: tuple[bytes, bytes] | None = None
) -> Iterator[Sample]:
    """``count`` samples that every receiver on ``robot`` must drop, or refuse if the topic is a query.

    Payload and envelope are mutated independently; where the mutated payload still decodes, as a message of the
    owner would, its envelope is made a wrong one. A sample ``recorded`` from the bus is sent again, too.
    """
    rng = random.Random(seed)  # noqa: S311, reproducible, not secret
    maker = _Maker(topic, robot, rng)
    for index in range(count):
        if recorded is not None and index % 10 == 0 and topic.delivery is not Delivery.QUERY:
            yield Sample(*recorded, "replayed")
        else:
            yield maker.sample()


class _Maker:
    """Makes the samples of one topic."""

    def __init__(self, topic: Topic, robot: str, rng: random.Random) -> None:
        examples = valid_examples()
        self._topic = topic
        self._robot = robot
        self._rng = rng
        self._example = examples[topic]
        self._valid = bytes(wire.encode(self._example))
        self._others = [bytes(wire.encode(message)) for message in examples.values()]
        owner = "operator" if topic.owners == ("*",) else topic.owners[0]
        self._owner = Source.of(robot, owner)
        self._payloads: tuple[Callable[[], bytes], ...] = (
            self._noise, self._mutated, self._truncated, self._other, self._hostile, self._huge, lambda: self._valid,
        )  # fmt: skip
        self._envelopes: dict[str, Callable[[bytes], bytes | None]] = {
            "no envelope": lambda _: None,
            "noise for an envelope": lambda _: self._noise(),
            "wrong checksum": lambda payload: self._seal(payload + b"x"),
            "wrong schema": lambda payload: self._seal(payload, schema=topics.SCHEMA + 1),
            "wrong robot": lambda payload: self._seal(payload, source=Source.of("stranger", self._owner.process)),
            "wrong types": lambda payload: bytes(
                msgpack.packb([float("inf"), "1", -1, list(self._owner), len(payload)])
            ),
        }
        if topic.owners != ("*",) and topic.delivery is not Delivery.QUERY:
            self._envelopes["wrong owner"] = lambda payload: self._seal(payload, source=Source.of(robot, "stranger"))

    def sample(self) -> Sample:
        payload = self._rng.choice(self._payloads)()
        if self._rng.random() < 0.5 and not self._decodes(payload):
            return Sample(payload, self._seal(payload), "malformed payload")
        kind = self._rng.choice(list(self._envelopes))
        return Sample(payload, self._envelopes[kind](payload), kind)

    def _decodes(self, payload: bytes) -> bool:
        try:
            wire.decode(self._topic.message, payload)
        except MalformedMessage:
            return False
        return True

    def _seal(self, payload: bytes, source: Source | None = None, schema: int = topics.SCHEMA) -> bytes:
        sequence = self._rng.choice((0, 1, 2**31, 2**63 - 1))
        return Envelope.seal(payload, source or self._owner, sequence, STAMP)._replace(schema=schema).pack()

    def _noise(self) -> bytes:
        return self._rng.randbytes(self._rng.choice((0, 1, 7, 8, 64, 300, 5000)))

    def _mutated(self) -> bytes:
        return mutated(self._valid, self._rng)

    def _truncated(self) -> bytes:
        return self._valid[: self._rng.randrange(len(self._valid))]

    def _other(self) -> bytes:
        return self._rng.choice(self._others)

    def _hostile(self) -> bytes:
        return hostile_header(self._rng)

    def _huge(self) -> bytes:
        fields = {name: getattr(self._example, name) for name in type(self._example).model_fields}
        fields[self._rng.choice(list(fields))] = self._rng.choice(_HUGE)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return wire.encode(type(self._example).model_construct(**fields))


def mutated(data: bytes, rng: random.Random) -> bytes:
    """``data`` with up to eight bytes changed, mostly near its beginning, where the header is."""
    out = bytearray(data)
    for _ in range(rng.randint(1, 8)):
        out[rng.randrange(min(len(out), rng.choice((64, 512, len(out)))))] = rng.randrange(256)
    return bytes(out)


def hostile_header(rng: random.Random) -> bytes:
    """A message whose header is well-formed msgpack made to exhaust or confuse its reader."""
    dtype, offset = rng.choice(("<f8", "|u1", "|O", 3, ["<f8"], "<M8[ns]")), rng.choice((0, 1, 64, 2**64 - 1, -64, "0"))
    array = [dtype, rng.choice(_SHAPES), offset]
    extension = msgpack.ExtType(rng.choice((0, 1, 2, 127)), msgpack.packb(array))
    header = rng.choice((
        msgpack.packb({"stamp": extension, "left": extension}),
        msgpack.packb({"stamp": msgpack.ExtType(1, b"\xc1"), "v": 1}),
        b"\x91" * rng.choice((100, 5000)) + b"\xc0",
        b"\xdf\xff\xff\xff\xff",
        b"\xdd\xff\xff\xff\xff\xc0",
        b"\xc6\xff\xff\xff\xff",
        msgpack.packb({1: 2}),
        msgpack.packb([extension]),
        msgpack.packb({"stamp": "\ud800"}, unicode_errors="surrogatepass"),
    ))  # fmt: skip
    size = rng.choice((len(header), len(header), 0, 2**32 - 1))
    return b"VTR1" + size.to_bytes(4, "little") + header + bytes(rng.choice((0, 64, 200)))


_SHAPES: tuple[object, ...] = (
    [4, 4], [2**63, 2**63], [2**64 - 1, 0], [2**62, 0, 2**62], [-1], [True, 4], [1.5], [1] * 70, 7, {"a": 1}, [],
)  # fmt: skip


def _camera() -> m.CameraModel:
    return m.CameraModel(
        width=20, height=16, fx=20.0, fy=20.0, cx=10.0, cy=8.0, baseline=0.2, T_vehicle_camera=np.eye(4)
    )


def _image() -> NDArray[np.uint8]:
    return np.arange(16 * 20 * 3, dtype=np.uint16).astype(np.uint8).reshape(16, 20, 3)


def _scan() -> m.LidarScan:
    return m.LidarScan(
        stamp=STAMP, T_vehicle_lidar=np.eye(4), ranges=np.full((4, 16), 3.5, np.float32),
        intensities=np.arange(64, dtype=np.uint8).reshape(4, 16), elevations=np.array([0.1, 0.0, -0.1, -0.2]),
        azimuths=np.linspace(3.0, -3.0, 16), offsets=np.linspace(-0.1, 0.0, 16),
    )  # fmt: skip


def _map() -> m.MapRecord:
    return m.MapRecord(id=MAP_ID, environment="park", stamp=STAMP, robot="r1", sensor="front")


def _vertex(vertex: VertexId) -> m.VertexRecord:
    arrays: dict[str, NDArray[Any]] = {"points": np.zeros((5, 3)), "descriptors": np.ones((5, 32), np.uint8)}
    appearance = {"plain": np.ones((2, 32), np.uint8)}
    keyframe = m.Keyframe(pipeline="stereo", camera=_camera(), arrays=arrays, thumbnail=b"jpeg", appearance=appearance)
    return m.VertexRecord(id=vertex, stamp=STAMP, keyframe=keyframe)


def _appearances() -> m.Appearances:
    return m.Appearances(
        maps=[_map()], vertices=np.array([[0, 3]], np.int32), counts={"plain": np.array([2], np.int32)},
        descriptors={"plain": np.ones((2, 32), np.uint8)}, more=False,
    )  # fmt: skip


def _route(vertex: VertexId) -> m.Route:
    return m.Route(
        id="r", environment="park", goal="gate", vertices=[vertex], path=np.eye(4)[None], length=0.0, maps=[MAP_ID],
        reason="the only one",
    )  # fmt: skip
