"""Writes the store that is kept here, with the program of the version that it is run in: see README.md."""

from __future__ import annotations

import contextlib
import sys
from itertools import pairwise
from pathlib import Path

import numpy as np

from common import geometry, messages
from common.ids import VertexId
from common.messages import Commit, EdgeRecord, Keyframe, MapRecord, NamePlace, VertexRecord, covariance_of
from services.mapstore.store import Store

MAPS = ("20261122T204500000000-r1-000000", "20261122T204600000000-r1-000001")
COUNTS = (4, 3)


def main(file: Path) -> None:
    """A finished map with two places, a repeat of it that was never finished, and whatever this version knows more."""
    with contextlib.closing(Store(file)) as store:
        for number, count in enumerate(COUNTS):
            for commit in drive(number, count):
                store.commit(commit)
        joint = edge("spatial", VertexId(MAPS[1], 0), VertexId(MAPS[0], 1), 0.1)
        store.commit(Commit(edges=[joint], finished=MAPS[0]))
        for place, index in (("dock", 0), ("gate", COUNTS[0] - 1)):
            store.name_place(NamePlace(environment="yard", place=place, vertex=VertexId(MAPS[0], index)))
        if hasattr(store, "ends"):
            store.ends(messages.MapEnds(map=MAPS[0], start_place="dock", end_place="gate"))
            store.set_sync(MAPS[0], messages.SyncState.SYNCED)
        if hasattr(store, "restrict"):
            store.restrict(messages.Restriction(map=MAPS[0], first=1, last=2, speed=0.4, reason="wet"))


def drive(number: int, count: int) -> list[Commit]:
    parent = MAPS[0] if number else None
    record = MapRecord(
        id=MAPS[number], environment="yard", stamp=number, robot="r1", sensor="stereo", generation=number, parent=parent
    )
    ids = [VertexId(MAPS[number], index) for index in range(count)]
    edges = [[], *([edge("temporal", a, b, 0.5)] for a, b in pairwise(ids))]
    return [
        Commit(map=record if k == 0 else None, vertex=_vertex(number, k, ids[k]), edges=edges[k]) for k in range(count)
    ]


def _vertex(number: int, index: int, place: VertexId) -> VertexRecord:
    descriptors = np.random.default_rng([number, index]).integers(0, 256, (6, 32), dtype=np.uint8)
    arrays = {"plain/descriptors": descriptors, "plain/points": np.full((6, 3), float(index))}
    fields = {"appearance": {"plain": descriptors[:2]}} if "appearance" in Keyframe.model_fields else {}
    keyframe = Keyframe(pipeline="stereo", arrays=arrays, thumbnail=b"jpeg", **fields)
    return VertexRecord(id=place, stamp=1000 * number + index, keyframe=keyframe)


def edge(kind: str, a: VertexId, b: VertexId, metres: float) -> EdgeRecord:
    T_a_b = geometry.from_xy_yaw(metres, 0, 0.1)
    return EdgeRecord(kind=kind, a=a, b=b, T_a_b=T_a_b, covariance=covariance_of([1e-4] * 6))


if __name__ == "__main__":
    main(Path(sys.argv[1]))
