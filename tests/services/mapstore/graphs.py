"""Small maps to commit."""

from __future__ import annotations

import numpy as np

from common import geometry
from common.ids import VertexId
from common.messages import Commit, EdgeRecord, Keyframe, MapRecord, VertexRecord, covariance_of


def map_id(number: int) -> str:
    return f"20261122T204500{number:06d}-r1-{number:06x}"


def record(number: int, environment: str = "yard", generation: int = 0) -> MapRecord:
    parent = map_id(0) if generation else None
    return MapRecord(
        id=map_id(number), environment=environment, stamp=number, robot="r1", sensor="front",
        generation=generation, parent=parent,
    )  # fmt: skip


def vertex_id(number: int, index: int) -> VertexId:
    return VertexId(map_id(number), index)


def keyframe(number: int, index: int, size: int = 1000) -> Keyframe:
    """A keyframe whose content follows from its place, so that it can be told from any other."""
    noise = np.random.default_rng([number, index]).integers(0, 256, size, dtype=np.uint8)
    return Keyframe(pipeline="stereo", arrays={"descriptors": noise, "points": np.eye(3)}, thumbnail=b"jpeg")


def vertex(number: int, index: int, size: int = 1000) -> VertexRecord:
    return VertexRecord(
        id=vertex_id(number, index), stamp=1000 * number + index, keyframe=keyframe(number, index, size)
    )


def temporal(number: int, index: int, metres: float = 0.5) -> EdgeRecord:
    return EdgeRecord(
        kind="temporal", a=vertex_id(number, index - 1), b=vertex_id(number, index),
        T_a_b=geometry.from_xy_yaw(metres, 0, 0.1), covariance=covariance_of([1e-4] * 6),
    )  # fmt: skip


def spatial(a: VertexId, b: VertexId, metres: float = 0.1) -> EdgeRecord:
    return EdgeRecord(
        kind="spatial", a=a, b=b, T_a_b=geometry.from_xy_yaw(metres, 0, 0), covariance=covariance_of([1e-4] * 6)
    )


def drive(number: int, count: int, *, finished: bool = True, size: int = 1000, **fields: object) -> list[Commit]:
    """The commits of a drive, as the estimator sends them."""
    commits = [Commit(map=record(number, **fields), vertex=vertex(number, 0, size))]  # type: ignore[arg-type]
    commits += [
        Commit(vertex=vertex(number, index, size), edges=[temporal(number, index)]) for index in range(1, count)
    ]
    if finished:
        commits.append(Commit(finished=map_id(number)))
    return commits
