"""Active search beside global matching: the same landmarks, the same live features, with and without knowing where.

In the synthetic world, whose truth is exact: a drive in the morning is sought in by another one, at noon.
"""

from __future__ import annotations

from datetime import UTC, datetime
from time import process_time
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from bench import table
from common import geometry
from common.camera import StereoCamera
from common.geometry import Array, Uncertain
from services.estimator.stereo import FeatureSet, StereoFrame, StereoSettings, local_map, matching, preprocess
from services.sensors.world import World, WorldSettings
from services.sensors.world.traversal import DrivingSettings, Traversal

_SIGMA = np.repeat([0.1, 0.02], 3)
"""Of the prior, metres and radians: what odometry leaves unknown over a few metres."""
_WRONG_PX = 2.5
_TIMES = (datetime(2026, 6, 21, 8, tzinfo=UTC), datetime(2026, 6, 21, 12, tzinfo=UTC))

Pairs = tuple[NDArray[np.int64], NDArray[np.int64]]


class _View(NamedTuple):
    """A preprocessed pair with its true pose, and the true depth (H, W) of its left image."""

    frame: StereoFrame
    T_world_left: Array
    depth: NDArray[np.float32]


def _drive(world: World, time: datetime, seed: int) -> list[_View]:
    traversal = Traversal.of(world, time, DrivingSettings(spacing=0.9), seed)
    s, camera = StereoSettings(), world.camera
    return [
        _View(preprocess(pair.left, pair.right, pair.stamp_ns, camera, s), T, world.render_depth())
        for pair, T in zip(traversal, traversal.poses_truth, strict=True)
    ]


def _active(landmarks: FeatureSet, live: StereoFrame, prior: Uncertain, camera: StereoCamera) -> Pairs:
    s = StereoSettings()
    found, features, _ = matching.search(landmarks, live.features, prior, camera, s.localization.matching, s.noise)
    return found, features


def _global(landmarks: FeatureSet, live: StereoFrame, *_: object) -> Pairs:
    """Brute force over all descriptors, with the same ratio test, and mutual."""
    matcher = cv2.BFMatcher(cv2.NORM_HAMMING)
    ratio = StereoSettings().localization.matching.ratio
    forth = matcher.knnMatch(landmarks.descriptors, live.features.descriptors, k=2)
    back = matcher.match(live.features.descriptors, landmarks.descriptors)
    mutual = {m.queryIdx: m.trainIdx for m in back}
    kept = [m for m, n in forth if m.distance < ratio * n.distance and mutual.get(m.trainIdx) == m.queryIdx]
    return np.array([m.queryIdx for m in kept], np.int64), np.array([m.trainIdx for m in kept], np.int64)


def _right(view: _View, landmarks: FeatureSet, live: _View, pairs: Pairs, camera: StereoCamera) -> int:
    """Matches that lie where the landmark's true place is seen."""
    m = landmarks.measurements[pairs[0]].astype(np.int64)
    z = view.depth[m[:, 1], m[:, 0]].astype(np.float64)
    ray = np.stack([(m[:, 0] - camera.cx) / camera.fx, (m[:, 1] - camera.cy) / camera.fy, np.ones(len(z))], axis=-1)
    T_live_map = geometry.inverse(live.T_world_left) @ view.T_world_left
    with np.errstate(invalid="ignore", divide="ignore"):
        true = camera.project(geometry.apply(T_live_map, ray * z[:, None]))
    error = (live.frame.features.measurements[pairs[1]] - true)[:, :2]
    return int((np.linalg.norm(error, axis=1) <= _WRONG_PX).sum())


def main() -> None:
    """Prints time, matches, and wrong ones among them, of both ways."""
    cv2.setNumThreads(1)
    world = World(WorldSettings(clouds=0.0))
    taught, repeated = (_drive(world, time, seed) for seed, time in enumerate(_TIMES))
    camera, settings, rng = world.camera, StereoSettings(), np.random.default_rng(1)
    places = np.array([view.T_world_left[:3, 3] for view in taught])
    figures: dict[str, list[tuple[float, int, int]]] = {"active search": [], "global, brute force": []}
    for live in repeated:
        view = taught[int(np.argmin(np.linalg.norm(places - live.T_world_left[:3, 3], axis=1)))]
        landmarks = local_map(view.frame.features, settings.mapping)
        T_live_map = geometry.inverse(live.T_world_left) @ view.T_world_left
        prior = Uncertain(geometry.exp(rng.normal(0.0, _SIGMA)) @ T_live_map, np.diag(_SIGMA**2))
        for name, way in zip(figures, (_active, _global), strict=True):
            way(landmarks, live.frame, prior, camera)
            begin = process_time()
            pairs = way(landmarks, live.frame, prior, camera)
            milliseconds = 1e3 * (process_time() - begin)
            figures[name].append((milliseconds, len(pairs[0]), _right(view, landmarks, live, pairs, camera)))
    rows: list[list[object]] = []
    for name, values in figures.items():
        milliseconds, matches, right = np.array(values).T
        wrong = 100.0 * (1.0 - right.sum() / matches.sum())
        rows.append([name, float(np.median(milliseconds)), float(matches.mean()), float(right.mean()), float(wrong)])
    table.show(
        f"active search: {len(repeated)} pairs at noon sought in a drive of the morning, one thread",
        ["matching", "search, ms", "matches a pair", "right", "wrong, %"],
        rows,
        note=f"right: within {_WRONG_PX} px of where the landmark's true place is seen",
    )


if __name__ == "__main__":
    main()
