"""Third stage, mapping: the local map of a vertex, and the joint map of several."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import fields, replace

import numpy as np

from common import geometry
from common.geometry import Uncertain
from services.estimator.stereo.features import FeatureSet
from services.estimator.stereo.settings import MappingSettings

_GRID = 6
"""Rows and columns of the grid over which kept landmarks are spread."""


def local_map(features: FeatureSet, settings: MappingSettings) -> FeatureSet:
    """The features that a vertex keeps: at most ``settings.max_landmarks``, spread over the image, the nearest first.

    Near landmarks fix the position, and those all over the image the rotation.
    """
    if len(features) <= settings.max_landmarks:
        return features
    places = features.measurements[:, :2]
    low, high = places.min(axis=0), places.max(axis=0)
    cells = np.minimum(((places - low) / (high - low + 1e-6) * _GRID).astype(np.int64), _GRID - 1)
    cell = cells[:, 1] * _GRID + cells[:, 0]
    order = np.lexsort((features.landmarks[:, 2], cell))
    starts = np.searchsorted(cell[order], cell[order])
    rank = np.empty(len(features), dtype=np.int64)
    rank[order] = np.arange(len(features)) - starts
    kept = np.argsort(rank, kind="stable")[: settings.max_landmarks]
    return features.select(np.sort(kept))


def move(features: FeatureSet, T_map_features: Uncertain, min_depth: float = 0.5) -> FeatureSet:
    """The features as landmarks of another frame, given by ``T_map_features`` between optical frames.

    The transform's covariance is added to the landmarks'. Those nearer than ``min_depth`` metres before the new
    frame, or behind it, are left out. ``measurements`` and ``depths`` stay those of the pair that saw them.
    """
    T = T_map_features.T
    points = geometry.apply(T, features.landmarks.astype(np.float64))
    by_pose = np.concatenate([np.broadcast_to(np.eye(3), (len(points), 3, 3)), -geometry.skew(points)], axis=-1)
    rotation = T[:3, :3]
    covariances = rotation @ features.covariances.astype(np.float64) @ rotation.T
    covariances += by_pose @ T_map_features.covariance @ by_pose.transpose(0, 2, 1)
    moved = replace(features, landmarks=points.astype(np.float32), covariances=covariances.astype(np.float32))
    return moved.select(points[:, 2] > min_depth)


def join(maps: Iterable[FeatureSet]) -> FeatureSet:
    """One map of several in the same frame."""
    listed = list(maps)
    if not listed:
        return FeatureSet.empty()
    return FeatureSet(**{f.name: np.concatenate([getattr(m, f.name) for m in listed]) for f in fields(FeatureSet)})
