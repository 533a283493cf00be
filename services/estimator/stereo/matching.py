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
from common.compiled import kernel
from common.geometry import Uncertain
from services.estimator.solving import small
from services.estimator.stereo import model, refinement
from services.estimator.stereo.brief import as_words, hamming
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
        noise: (K, 3, 3) their covariances, square pixels.
    """

    landmarks: NDArray[np.int64]
    features: NDArray[np.int64]
    uvd: Array
    noise: Array


class Predictions(NamedTuple):
    """How N landmarks will appear in a live frame.

    Attributes:
        uvd: (N, 3) predicted measurements.
        covariances: (N, 3, 3) of them, with the measurement's own noise.
        ratios: (N,) of live to stored depth; not positive behind the camera.
        warps: (N, 2, 2) from an offset in the stored patch to one in the live image.
    """

    uvd: Array
    covariances: Array
    ratios: Array
    warps: Array


@kernel
def _predict_all(
    uvd: Array, landmark_covariances: Array, slants: Array, T: Array, pose_covariance: Array, k: Array, noise: Array
) -> Predictions:
    """What the landmarks' measurements will be, for their slants (N,) and the noise (3, 3) of a measurement."""
    n = uvd.shape[0]
    predicted, covariances, ratios, warps = np.zeros((n, 3)), np.zeros((n, 3, 3)), np.zeros(n), np.zeros((n, 2, 2))
    by_pose, by_landmark = np.zeros((3, 6)), np.zeros((3, 3))
    for i in range(n):
        ratios[i] = model.predict(uvd[i], T, k, predicted[i])
        if ratios[i] > 0.0:
            model.derivatives(uvd[i], T, k, by_pose, by_landmark)
            small.innovation_covariance(by_landmark, landmark_covariances[i], noise, covariances[i])
            small.add_quadratic(by_pose, pose_covariance, covariances[i])
            for a in range(2):
                warps[i, a, 0] = by_landmark[a, 0]
                warps[i, a, 1] = by_landmark[a, 1] + by_landmark[a, 2] * slants[i]
    return Predictions(predicted, covariances, ratios, warps)


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
        if small.quadratic3(error, information) > gate * gate:
            continue
        distance = hamming(words, live_words[j])
        if distance < best:
            best, second, chosen = distance, best, j
        elif distance < second:
            second = distance
    return chosen, best, second


@kernel
def _search(
    predictions: Predictions,
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
    predicted, covariances, ratios = predictions.uvd, predictions.covariances, predictions.ratios
    n = predicted.shape[0]
    match = np.full(n, -1, np.int64)
    owner, owner_distance = np.full(live_uvd.shape[0], -1, np.int64), np.full(live_uvd.shape[0], 257, np.int64)
    information = np.zeros((3, 3))
    for i in range(n):
        if ratios[i] <= 0.0 or not small.invert3(covariances[i], information):
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
    and into the live features, and the predicted warps (K, 2, 2) of their patches.
    """
    none = np.zeros(0, dtype=np.int64)
    if len(landmarks) == 0 or len(live) == 0:
        return none, none, np.zeros((0, 2, 2))
    k = model.intrinsics(camera)
    uvd, covariances = model.as_uvd(landmarks.landmarks, landmarks.covariances, k)
    place = np.diag([noise.detection**2, noise.detection**2, noise.detection_disparity**2])
    slants = landmarks.slants.astype(np.float64)
    predictions = _predict_all(uvd, covariances, slants, prior.T, prior.covariance, k, place)
    live_uvd = _live_uvd(live, camera)
    row_starts = np.searchsorted(live_uvd[:, 1], np.arange(camera.height + 1)).astype(np.int64)
    match = _search(
        predictions, as_words(landmarks.descriptors), live_uvd, as_words(live.descriptors), row_starts,
        settings.gate, settings.max_radius, settings.max_hamming, settings.ratio,
    )  # fmt: skip
    found = np.flatnonzero(match >= 0)
    # A map that was moved to another frame keeps the patches of the frame that saw them.
    seen_from = landmarks.depths[found] / landmarks.landmarks[found, 2]
    return found, match[found], predictions.warps[found] * seen_from[:, None, None]


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
    found, features, predicted = search(landmarks, live.features, prior, camera, settings, noise)
    if len(found) > settings.max_matches:
        nearest = np.sort(np.argsort(landmarks.landmarks[found, 2], kind="stable")[: settings.max_matches])
        found, features, predicted = found[nearest], features[nearest], predicted[nearest]
    bounded, scales = _bounded(predicted)
    uvd = _live_uvd(live.features, camera)[features]
    starts = uvd[:, :2].astype(np.float32)
    refined = refinement.align(landmarks.patches[found], live.left, starts, bounded, settings.refine_iterations)
    moved = refined[:, :2] - starts
    good = (refined[:, 2] >= settings.min_correlation) & (
        np.abs(moved).max(axis=1, initial=0.0) <= settings.max_refine_shift
    )
    uvd[:, :2] = refined[:, :2]
    uvd[:, 2] += live.features.slants[features] * moved[:, 1]
    covariances = _noise(refined, live.features.disparity_sigmas[features], scales, noise)
    return Matches(found[good], features[good], uvd[good], covariances[good])


def _noise(
    refined: NDArray[np.float32], disparity_sigmas: NDArray[np.float32], scales: Array, noise: NoiseSettings
) -> Array:
    """Covariances (K, 3, 3) of measurements whose places were aligned."""
    out = np.zeros((len(refined), 3, 3))
    out[:, :2, :2] = place_noise(refined, scales, noise)
    out[:, 2, 2] = disparity_sigmas.astype(np.float64) ** 2
    return out


def place_noise(refined: NDArray[np.float32], scales: Array, noise: NoiseSettings) -> Array:
    """Covariances (K, 2, 2) of places from :func:`refinement.align`: what the fit says, and what no fit can."""
    out = np.zeros((len(refined), 2, 2))
    unseen = noise.pixel**2 + (noise.parallax * np.log(scales)) ** 2
    out[:, 0, 0], out[:, 1, 1] = refined[:, 3] + unseen, refined[:, 5] + unseen
    out[:, 0, 1] = out[:, 1, 0] = refined[:, 4]
    return out


def warps(landmarks: FeatureSet, T_live_map: Uncertain, camera: StereoCamera) -> tuple[NDArray[np.float32], Array]:
    """Warps (N, 2, 2) under which the patches of landmarks appear in a live frame, and their scales (N,)."""
    uvd, covariances = model.as_uvd(landmarks.landmarks, landmarks.covariances, model.intrinsics(camera))
    predictions = _predict_all(
        uvd, covariances, landmarks.slants.astype(np.float64), T_live_map.T, T_live_map.covariance,
        model.intrinsics(camera), np.zeros((3, 3)),
    )  # fmt: skip
    return _bounded(predictions.warps)


def _bounded(warps: Array) -> tuple[NDArray[np.float32], Array]:
    """Warps (N, 2, 2) whose scales are brought between bounds, and the scales (N,) before that."""
    scales = np.sqrt(np.maximum(np.abs(np.linalg.det(warps)), 1e-6))
    return (warps * (np.clip(scales, *_SCALE_RANGE) / scales)[:, None, None]).astype(np.float32), scales
