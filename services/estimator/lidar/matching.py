"""Active search: a landmark is looked for only where it can have been measured.

The covariances of the prior, of the landmark and of a keypoint together give that of the predicted azimuth, elevation
and range; among the keypoints within it the most similar one is taken, if no other is nearly as similar.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from common.compiled import kernel
from common.geometry import Uncertain
from services.estimator.lidar import model
from services.estimator.lidar.features import Landmarks, LidarFeatures
from services.estimator.lidar.settings import MatchingSettings
from services.estimator.solving import small

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

_OWN = 0.02
"""What a live keypoint's own noise may add to the region, radians."""


class Matches(NamedTuple):
    """K landmarks of a map found in a live scan: indices (K,) into the map's landmarks and the scan's features."""

    landmarks: Indices
    features: Indices


@kernel
def _similar(a: NDArray[np.float32], b: NDArray[np.float32]) -> float:
    """Squared distance of two descriptors of length 1."""
    total = np.float32(0.0)
    for i in range(a.shape[0]):
        total += a[i] * b[i]
    return 2.0 - 2.0 * float(total)


class _Live(NamedTuple):
    """A live scan's M keypoints, in the order of azimuth, for the compiled loops."""

    measurements: Array
    covariances: Array
    looks: NDArray[np.float32]
    signs: NDArray[np.int8]


@kernel
def _best_in_region(
    predicted: Array, spread: Array, look: NDArray[np.float32], sign: int, live: _Live, azimuths: Array, gate: float,
    max_radius: float, work: tuple[Array, Array, Array],
) -> tuple[int, float, float]:  # fmt: skip
    """The live keypoint of the region that looks most alike (-1: none), its squared distance and the next one's."""
    error, whole, information = work
    count = azimuths.shape[0]
    # A live keypoint's own part of the region is known when it is looked at: no more than this is of use.
    reach = min(gate * np.sqrt(spread[0, 0]) + _OWN, max_radius)
    reach_up = min(gate * np.sqrt(spread[1, 1]) + _OWN, max_radius)
    start = np.searchsorted(azimuths, predicted[0] - reach)
    if predicted[0] - reach < -np.pi:
        start = np.searchsorted(azimuths, predicted[0] - reach + 2.0 * np.pi) - count
    best, second, chosen = np.inf, np.inf, -1
    for k in range(start, start + count):
        j = k % count
        model.difference(live.measurements[j], predicted, error)
        if error[0] > reach:
            break
        if abs(error[1]) > reach_up or live.signs[j] != sign:
            continue
        for a in range(3):
            for b in range(3):
                whole[a, b] = spread[a, b] + live.covariances[j, a, b]
        if not small.invert3(whole, information) or small.quadratic3(error, information) > gate * gate:
            continue
        distance = _similar(look, live.looks[j])
        if distance < best:
            best, second, chosen = distance, best, j
        elif distance < second:
            second = distance
    return chosen, best, second


@kernel
def _search(
    points: Array, covariances: Array, looks: NDArray[np.float32], signs: NDArray[np.int8], live: _Live,
    T: Array, pose_covariance: Array, gate: float, max_radius: float, max_distance2: float, ratio2: float,
) -> Indices:  # fmt: skip
    """Index (N,) of the live keypoint that each landmark matches, -1 where none does, unambiguously and mutually."""
    n, count = points.shape[0], live.measurements.shape[0]
    match = np.full(n, -1, np.int64)
    owner, owner_distance = np.full(count, -1, np.int64), np.full(count, np.inf)
    moved, predicted, nothing, spread = np.zeros(3), np.zeros(3), np.zeros((3, 3)), np.zeros((3, 3))
    by_pose, by_landmark = np.zeros((3, 6)), np.zeros((3, 3))
    work = (np.zeros(3), np.zeros((3, 3)), np.zeros((3, 3)))
    azimuths = live.measurements[:, 0].copy()
    for i in range(n):
        if not model.predict(points[i], T, moved, predicted):
            continue
        model.derivatives(moved, T, by_pose, by_landmark)
        small.innovation_covariance(by_landmark, covariances[i], nothing, spread)
        small.add_quadratic(by_pose, pose_covariance, spread)
        chosen, best, second = _best_in_region(
            predicted, spread, looks[i], signs[i], live, azimuths, gate, max_radius, work
        )
        if chosen < 0 or best > max_distance2 or best > ratio2 * second or best >= owner_distance[chosen]:
            continue
        if owner[chosen] >= 0:
            match[owner[chosen]] = -1
        owner[chosen], owner_distance[chosen] = i, best
        match[i] = chosen
    return match


def match(landmarks: Landmarks, live: LidarFeatures, prior: Uncertain, settings: MatchingSettings) -> Matches:
    """The landmarks of a map among the keypoints of a live scan; ``prior`` is ``T_live_map`` between lidar frames."""
    if len(landmarks) == 0 or len(live) == 0:
        none = np.zeros(0, dtype=np.int64)
        return Matches(none, none)
    found = _search(
        landmarks.points.astype(np.float64), landmarks.covariances.astype(np.float64), landmarks.looks,
        landmarks.laplacians, _Live(live.measurements, live.covariances, live.descriptors, live.laplacians), prior.T,
        prior.covariance, settings.gate, settings.max_radius, settings.max_distance**2, settings.ratio**2,
    )  # fmt: skip
    chosen = np.flatnonzero(found >= 0)
    return Matches(chosen, found[chosen])
