"""Active search: a landmark is looked for only where everything that is known says that it reprojects.

Section II-B of C. McManus et al., *Shady dealings*, ICRA 2014, after A. Davison et al., *MonoSLAM*, PAMI 2007: the
covariances of the prior, of the landmark and of the measurement together give the covariance of the predicted
measurement, and with it a region in the image and an interval of disparities.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from common.camera import StereoCamera
from common.geometry import Uncertain
from services.estimator.stereo import model, refinement
from services.estimator.stereo.brief import as_words, hamming
from services.estimator.stereo.compiled import kernel
from services.estimator.stereo.features import FeatureSet, StereoFrame
from services.estimator.stereo.settings import MatchingSettings, NoiseSettings

Array = NDArray[np.float64]

_SCALE_RANGE = (0.5, 2.0)
"""Scales between which a patch is still compared, pixels per pixel."""


class Matches(NamedTuple):
    """K landmarks of a map found in a live frame.

    Attributes:
        landmarks, features: (K,) indices into the map's and the frame's features.
        uvd: (K, 3) the measurements ``(u, v, d)`` in the live frame, pixels.
        noise: (K, 3) their variances, square pixels.
    """

    landmarks: NDArray[np.int64]
    features: NDArray[np.int64]
    uvd: Array
    noise: Array


@kernel
def _predict_all(
    uvd: Array, landmark_covariances: Array, T: Array, pose_covariance: Array, k: Array, noise: Array
) -> tuple[Array, Array, Array]:
    """Predicted measurements (N, 3), their covariances (N, 3, 3) and the ratios (N,) of live to stored depth."""
    n = uvd.shape[0]
    predicted, covariances, ratios = np.zeros((n, 3)), np.zeros((n, 3, 3)), np.zeros(n)
    by_pose, by_landmark = np.zeros((3, 6)), np.zeros((3, 3))
    for i in range(n):
        ratios[i] = model.predict(uvd[i], T, k, predicted[i])
        if ratios[i] > 0.0:
            model.derivatives(uvd[i], T, k, by_pose, by_landmark)
            model.innovation_covariance(by_landmark, landmark_covariances[i], noise, covariances[i])
            model.add_quadratic(by_pose, pose_covariance, covariances[i])
    return predicted, covariances, ratios


@kernel
def _best_in_region(
    centre: Array,
    covariance: Array,
    information: Array,
    words: NDArray[np.uint64],
    live_uvd: Array,
    live_words: NDArray[np.uint64],
    row_starts: NDArray[np.int64],
    gate: float,
    max_radius: float,
) -> tuple[int, int, int]:
    """The live feature of the region whose descriptor is nearest (-1: none), its distance and the next one's."""
    rows = row_starts.shape[0] - 1
    reach_u = min(gate * math.sqrt(covariance[0, 0]), max_radius)
    reach_v = min(gate * math.sqrt(covariance[1, 1]), max_radius)
    first, last = math.floor(centre[1] - reach_v), math.ceil(centre[1] + reach_v)
    best, second, chosen = 257, 257, -1
    if last < 0 or first >= rows:
        return chosen, best, second
    error = np.zeros(3)
    for j in range(row_starts[max(first, 0)], row_starts[min(last + 1, rows)]):
        error[0] = live_uvd[j, 0] - centre[0]
        if abs(error[0]) > reach_u:
            continue
        error[1], error[2] = live_uvd[j, 1] - centre[1], live_uvd[j, 2] - centre[2]
        if model.quadratic3(error, information) > gate * gate:
            continue
        distance = hamming(words, live_words[j])
        if distance < best:
            best, second, chosen = distance, best, j
        elif distance < second:
            second = distance
    return chosen, best, second


@kernel
def _search(
    predicted: Array,
    covariances: Array,
    ratios: Array,
    words: NDArray[np.uint64],
    live_uvd: Array,
    live_words: NDArray[np.uint64],
    row_starts: NDArray[np.int64],
    gate: float,
    max_radius: float,
    max_hamming: int,
    ratio: float,
) -> NDArray[np.int64]:
    """Index (N,) of the live feature that each landmark matches, -1 where none does, unambiguously and mutually."""
    n = predicted.shape[0]
    match = np.full(n, -1, np.int64)
    owner, owner_distance = np.full(live_uvd.shape[0], -1, np.int64), np.full(live_uvd.shape[0], 257, np.int64)
    information = np.zeros((3, 3))
    for i in range(n):
        if ratios[i] <= 0.0 or not model.invert3(covariances[i], information):
            continue
        chosen, best, second = _best_in_region(
            predicted[i], covariances[i], information, words[i], live_uvd, live_words, row_starts, gate, max_radius
        )
        if chosen < 0 or best > max_hamming or best > ratio * second or best >= owner_distance[chosen]:
            continue
        if owner[chosen] >= 0:
            match[owner[chosen]] = -1
        owner[chosen], owner_distance[chosen] = i, best
        match[i] = chosen
    return match


def _live_uvd(features: FeatureSet, camera: StereoCamera) -> Array:
    """Measurements (N, 3) ``(u, v, d)`` with the disparity of the landmark, from which known errors are taken off."""
    uvd = features.measurements.astype(np.float64)
    uvd[:, 2] = camera.fx * camera.baseline / features.landmarks[:, 2]
    return uvd


def search(
    landmarks: FeatureSet,
    live: FeatureSet,
    prior: Uncertain,
    camera: StereoCamera,
    settings: MatchingSettings,
    noise: NoiseSettings,
) -> tuple[NDArray[np.int64], NDArray[np.int64], Array]:
    """Find the landmarks of a map among the features of a live frame, by region and descriptor.

    ``prior`` is ``T_live_map`` between optical frames; ``live`` is in reading order. Returns indices (K,) into the map
    and into the live features, and the ratio (K,) of the predicted live depth to the depth in the map's frame.
    """
    none = np.zeros(0, dtype=np.int64)
    if len(landmarks) == 0 or len(live) == 0:
        return none, none, np.zeros(0)
    k = model.intrinsics(camera)
    uvd, covariances = model.as_uvd(landmarks.landmarks, landmarks.covariances, k)
    variances = np.array([noise.detection**2, noise.detection**2, noise.disparity**2])
    predicted, regions, ratios = _predict_all(uvd, covariances, prior.T, prior.covariance, k, variances)
    live_uvd = _live_uvd(live, camera)
    row_starts = np.searchsorted(live_uvd[:, 1], np.arange(camera.height + 1)).astype(np.int64)
    match = _search(
        predicted, regions, ratios, as_words(landmarks.descriptors), live_uvd, as_words(live.descriptors), row_starts,
        settings.gate, settings.max_radius, settings.max_hamming, settings.ratio,
    )  # fmt: skip
    found = np.flatnonzero(match >= 0)
    return found, match[found], ratios[found]


def match(
    landmarks: FeatureSet,
    live: StereoFrame,
    prior: Uncertain,
    camera: StereoCamera,
    settings: MatchingSettings,
    noise: NoiseSettings,
) -> Matches:
    """Active search, then sub-pixel refinement in the live image by patch.

    ``prior`` is ``T_live_map`` between optical frames. Landmarks must lie before the map's frame.
    """
    found, features, ratios = search(landmarks, live.features, prior, camera, settings, noise)
    if len(found) > settings.max_matches:
        nearest = np.sort(np.argsort(landmarks.landmarks[found, 2], kind="stable")[: settings.max_matches])
        found, features, ratios = found[nearest], features[nearest], ratios[nearest]
    live_depths = ratios * landmarks.landmarks[found, 2]
    scales = landmarks.depths[found] / live_depths
    uvd = _live_uvd(live.features, camera)[features]
    starts = uvd[:, :2].astype(np.float32)
    refined = refinement.align(
        landmarks.patches[found], live.left, starts, np.clip(scales, *_SCALE_RANGE).astype(np.float32),
        settings.refine_iterations,
    )  # fmt: skip
    good = (refined[:, 2] >= settings.min_correlation) & (
        np.abs(refined[:, :2] - starts).max(axis=1, initial=0.0) <= settings.max_refine_shift
    )
    uvd[:, :2] = refined[:, :2]
    place = noise.pixel**2 + (noise.parallax * np.log(np.maximum(scales, 1e-3))) ** 2
    variances = np.stack([place, place, np.full_like(place, noise.disparity**2)], axis=-1)
    return Matches(found[good], features[good], uvd[good], variances[good])
