"""Third stage, mapping: the local map of a vertex, and the joint submap of several."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray

from common import geometry
from common.geometry import Array, Uncertain
from services.estimator.lidar import model
from services.estimator.lidar.features import Landmarks
from services.estimator.lidar.settings import MappingSettings

_SECTORS, _LAYERS = 18, 4
"""Cells by azimuth and by elevation over which kept landmarks are spread."""


@dataclass(frozen=True, slots=True)
class LidarSubmap:
    """Landmarks in the lidar's frame at a vertex, and where that lidar sits on its vehicle.

    Attributes:
        landmarks: of all members.
        owners: (N,) which member of a joint submap each landmark is of.
        T_vehicle_lidar: (4, 4).
        size: how many vertices' landmarks were joined.
    """

    landmarks: Landmarks
    owners: NDArray[np.int64]
    T_vehicle_lidar: Array
    size: int = 1

    @classmethod
    def of(cls, landmarks: Landmarks, T_vehicle_lidar: Array) -> LidarSubmap:
        """The submap of one vertex."""
        return cls(landmarks, np.zeros(len(landmarks), dtype=np.int64), T_vehicle_lidar)


def local_map(landmarks: Landmarks, settings: MappingSettings) -> Landmarks:
    """The landmarks that a vertex keeps: at most ``settings.max_landmarks``, spread all around, the surest first."""
    if len(landmarks) <= settings.max_landmarks:
        return landmarks
    azimuth, elevation, _ = model.to_measurements(landmarks.points).T
    sector = np.clip(((azimuth + np.pi) / (2.0 * np.pi) * _SECTORS).astype(np.int64), 0, _SECTORS - 1)
    low, high = elevation.min(), elevation.max()
    layer = np.minimum(((elevation - low) / (high - low + 1e-6) * _LAYERS).astype(np.int64), _LAYERS - 1)
    cell = sector * _LAYERS + layer
    order = np.lexsort((np.trace(landmarks.covariances, axis1=1, axis2=2), cell))
    starts = np.searchsorted(cell[order], cell[order])
    rank = np.empty(len(landmarks), dtype=np.int64)
    rank[order] = np.arange(len(landmarks)) - starts
    return landmarks.select(np.sort(np.argsort(rank, kind="stable")[: settings.max_landmarks]))


def move(landmarks: Landmarks, T_map_landmarks: Uncertain) -> Landmarks:
    """The landmarks in another frame; the transform's covariance is added to theirs."""
    T = T_map_landmarks.T
    points = geometry.apply(T, landmarks.points.astype(np.float64))
    by_pose = np.concatenate([np.broadcast_to(np.eye(3), (len(points), 3, 3)), -geometry.skew(points)], axis=-1)
    covariances = T[:3, :3] @ landmarks.covariances.astype(np.float64) @ T[:3, :3].T
    covariances += by_pose @ T_map_landmarks.covariance @ by_pose.transpose(0, 2, 1)
    return replace(landmarks, points=points.astype(np.float32), covariances=covariances.astype(np.float32))


def joined(members: Sequence[tuple[LidarSubmap, Uncertain]]) -> LidarSubmap:
    """One submap of several, each with ``T_first_vertex`` between vehicle frames, in the first one's frame."""
    first = members[0][0]
    if len(members) == 1:
        return first
    T_lidar_vehicle = Uncertain.exactly(geometry.inverse(first.T_vehicle_lidar))
    parts = [first.landmarks] + [
        move(member.landmarks, T_lidar_vehicle @ T @ Uncertain.exactly(member.T_vehicle_lidar))
        for member, T in members[1:]
    ]
    whole = Landmarks(**{f.name: np.concatenate([getattr(p, f.name) for p in parts]) for f in fields(Landmarks)})
    owners = np.repeat(np.arange(len(parts)), [len(part) for part in parts]).astype(np.int64)
    return LidarSubmap(whole, owners, first.T_vehicle_lidar, len(parts))
