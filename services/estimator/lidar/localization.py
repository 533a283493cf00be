"""Fifth stage, localization: the live scan against a map of landmarks.

The map is the local map of one vertex, or a joint one of several, moved to one frame (:mod:`mapping`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from common.geometry import Uncertain
from services.estimator import criteria
from services.estimator.lidar import matching, solver
from services.estimator.lidar.features import Landmarks
from services.estimator.lidar.matching import Matches
from services.estimator.lidar.preprocessing import LidarFrame
from services.estimator.lidar.search import search
from services.estimator.lidar.settings import LidarSettings, LocalizationSettings


@dataclass(frozen=True, slots=True)
class LocalizationResult:
    """Where the live scan is in a map.

    Attributes:
        success: whether every criterion is met; if not, the transform is the prior's.
        reason: which criterion is not met, in one sentence; empty on success.
        T_map_live: live lidar frame in the map's, with covariance.
        matches, inliers: landmarks found, and those that agree on the pose.
        rms: root mean square distance of the inliers, metres.
        mahalanobis2: squared distance from the prior, 6 degrees of freedom; nan without a pose.
        inlier_landmarks: indices into the map of the landmarks that agree.
        inlier_pixels: (inliers, 2) columns and rows of the live scan where they were found.
    """

    success: bool
    reason: str
    T_map_live: Uncertain
    matches: int
    inliers: int
    rms: float
    mahalanobis2: float
    inlier_landmarks: NDArray[np.int64]
    inlier_pixels: NDArray[np.float32]


class LidarLocalizer:
    """Localisation of a lidar; it keeps no state between calls."""

    def __init__(self, settings: LidarSettings | None = None) -> None:
        self.settings = settings or LidarSettings()

    def localize(self, landmarks: Landmarks, live: LidarFrame, prior: Uncertain) -> LocalizationResult:
        """Pose of the live scan in a map, guided by ``prior``, ``T_map_live`` between lidar frames."""
        s = self.settings.localization
        T_live_map = prior.inverse()
        found = matching.match(landmarks, live.features, T_live_map, s.matching)
        # The prior guides the search and judges the outcome; the pose itself comes from the scan alone, since a prior
        # that is fused again at every scan would count its own past as new evidence.
        solution = solver.solve_matches(landmarks, live.features, found, T_live_map.T, s.matching)
        return _judge(prior, landmarks, live, found, solution, s.min_inliers, s)

    def localize_without_prior(self, landmarks: Landmarks, live: LidarFrame) -> LocalizationResult:
        """Pose of the live scan in a map of which only the neighbourhood is known."""
        s = self.settings.localization
        guess = criteria.neighbourhood(s)
        everywhere = replace(s.matching, max_radius=np.pi, ransac_iterations=s.search_iterations)
        found, solution = search(landmarks, live.features, live.ranges, guess.inverse(), s.matching, everywhere)
        return _judge(guess, landmarks, live, found, solution, s.search_min_inliers, s)


def _judge(
    prior: Uncertain,
    landmarks: Landmarks,
    live: LidarFrame,
    found: Matches,
    solution: solver.Solution | None,
    min_inliers: int,
    settings: LocalizationSettings,
) -> LocalizationResult:
    """Apply the criteria of success."""
    matches = len(found.landmarks)
    T_map_live, inliers, mahalanobis2 = prior, np.zeros(matches, dtype=np.bool_), float("nan")
    reason = f"no pose fits the {matches} landmarks that were found"
    if solution is not None:
        # The map's scan was corrected for its motion as the live one is, and no better.
        corrections = Uncertain(np.eye(4), 2.0 * live.correction)
        T_map_live, inliers = solution.T_live_map.inverse() @ corrections, solution.inliers
        mahalanobis2 = T_map_live.mahalanobis2(prior)
        agreement = live.ranges.agreement(landmarks.points, solution.T_live_map.T)
        reason = _objection(T_map_live, inliers, agreement, mahalanobis2, min_inliers, settings)
    return LocalizationResult(
        success=not reason,
        reason=reason,
        T_map_live=prior if reason else T_map_live,
        matches=matches,
        inliers=int(inliers.sum()),
        rms=solution.rms if solution else 0.0,
        mahalanobis2=mahalanobis2,
        inlier_landmarks=found.landmarks[inliers],
        inlier_pixels=live.features.pixels[found.features[inliers]],
    )


def _objection(
    T_map_live: Uncertain,
    inliers: NDArray[np.bool_],
    agreement: float,
    mahalanobis2: float,
    min_inliers: int,
    settings: LocalizationSettings,
) -> str:
    """Why a pose is not to be believed, in one sentence; empty if it is."""
    if few := criteria.too_few(int(inliers.sum()), len(inliers), min_inliers, settings):
        return few
    if agreement < settings.min_agreement:
        return f"only {100 * agreement:.0f} % of the landmarks in view are where the pose puts them"
    if uncertain := criteria.too_uncertain(T_map_live.covariance, settings):
        return uncertain
    if not mahalanobis2 <= settings.max_mahalanobis2:
        return "the pose contradicts the prior"
    return ""
