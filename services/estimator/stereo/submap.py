"""What a vertex keeps for localization: its landmarks in each stream, and the joint submap of several vertices."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from common import geometry
from common.geometry import Array, Uncertain
from services.estimator.stereo.features import FeatureSet
from services.estimator.stereo.mapping import join, move
from services.estimator.stereo.streams import INVARIANT, PLAIN


@dataclass(frozen=True, slots=True)
class StereoSubmap:
    """Landmarks in the optical frame of a vertex, and where that camera sits on its vehicle.

    Attributes:
        streams: landmarks by the name of the stream.
        owners: which member of a joint submap each landmark is of, by the name of the stream; (N,) int64 each.
        T_vehicle_camera: (4, 4).
        size: how many vertices' landmarks were joined.
    """

    streams: Mapping[str, FeatureSet]
    owners: Mapping[str, NDArray[np.int64]]
    T_vehicle_camera: Array
    size: int = 1

    @classmethod
    def of(cls, streams: Mapping[str, FeatureSet], T_vehicle_camera: Array) -> StereoSubmap:
        """The submap of one vertex."""
        owners = {name: np.zeros(len(features), dtype=np.int64) for name, features in streams.items()}
        return cls(streams, owners, T_vehicle_camera)


def to_arrays(streams: Mapping[str, FeatureSet]) -> dict[str, NDArray[Any]]:
    """The streams' landmarks as named arrays, ``<stream>/<array>``, as a keyframe stores them."""
    return {f"{name}/{key}": array for name, features in streams.items() for key, array in features.to_arrays().items()}


def from_arrays(arrays: Mapping[str, NDArray[Any]]) -> dict[str, FeatureSet]:
    """Inverse of :func:`to_arrays`; the plain stream must be there, the invariant one may be missing.

    Raises:
        FeatureError: a stream is not whole.
    """
    found = {name.partition("/")[0] for name in arrays}
    return {
        stream: FeatureSet.from_arrays(
            {key.partition("/")[2]: array for key, array in arrays.items() if key.startswith(f"{stream}/")}
        )
        for stream in (PLAIN, INVARIANT)
        if stream == PLAIN or stream in found
    }


def joined(members: Sequence[tuple[StereoSubmap, Uncertain]]) -> StereoSubmap:
    """One submap of several vertices', each with ``T_first_vertex`` between vehicle frames, in the first one's frame.

    The uncertainty of where a vertex lies is added to that of its landmarks.
    """
    first = members[0][0]
    if len(members) == 1:
        return first
    T_camera_vehicle = Uncertain.exactly(geometry.inverse(first.T_vehicle_camera))
    streams: dict[str, FeatureSet] = {}
    owners: dict[str, NDArray[np.int64]] = {}
    poses = [T_camera_vehicle @ T @ Uncertain.exactly(member.T_vehicle_camera) for member, T in members]
    for name in dict.fromkeys(name for member, _ in members for name in member.streams):
        parts = [
            (k, member.streams[name] if k == 0 else move(member.streams[name], poses[k]))
            for k, (member, _) in enumerate(members)
            if name in member.streams
        ]
        streams[name] = join(part for _, part in parts)
        owners[name] = np.repeat([k for k, _ in parts], [len(part) for _, part in parts]).astype(np.int64)
    return StereoSubmap(streams, owners, first.T_vehicle_camera, len(members))
