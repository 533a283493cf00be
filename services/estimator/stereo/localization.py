"""Fifth stage, localization: the live pair against a map of landmarks.

The map is the local map of one vertex, or a joint map of several, moved to one frame (:mod:`mapping`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from common.camera import StereoCamera
from common.geometry import Uncertain
from services.estimator import criteria
from services.estimator.mounting import in_vehicle_frames
from services.estimator.stereo import matching, model, solver
from services.estimator.stereo.features import FeatureSet, StereoFrame
from services.estimator.stereo.rectification import Rectification
from services.estimator.stereo.settings import LocalizationSettings, MatchingSettings, StereoSettings

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class LocalizationResult:
    """Where the live pair is in a map.

    Attributes:
        success: whether every criterion is met; if not, the transforms are the prior's.
        reason: which criterion is not met, in one sentence; empty on success.
        T_map_live: live left optical frame in the map's optical frame, with covariance.
        T_map_live_vehicle: the same between vehicle frames.
        matches, inliers: landmarks found and refined, and those that agree on the pose.
        rms: root mean square error of the inliers in the left image, pixels.
        mahalanobis2: squared distance from the prior, 6 degrees of freedom; nan without a pose.
        inlier_landmarks: indices into the map of the landmarks that agree.
        inlier_places: x, y (inliers, 2) of these in the live left image, pixels.
    """

    success: bool
    reason: str
    T_map_live: Uncertain
    T_map_live_vehicle: Uncertain
    matches: int
    inliers: int
    rms: float
    mahalanobis2: float
    inlier_landmarks: NDArray[np.int64]
    inlier_places: Array


class StereoLocalizer:
    """Localisation of one stream; it keeps no state between calls."""

    def __init__(self, camera: StereoCamera, settings: StereoSettings | None = None) -> None:
        self.camera = camera
        self.settings = settings or StereoSettings()
        self._intrinsics = model.intrinsics(camera)
        s = self.settings
        self._rectification = Rectification.unknown(s.noise).covariance * s.localization.rectification**2

    def localize(self, local_map: FeatureSet, live: StereoFrame, prior: Uncertain) -> LocalizationResult:
        """Pose of the live pair in a map, guided by ``prior``, ``T_map_live`` between optical frames."""
        s = self.settings.localization
        found, solution = self._measure(local_map, live, prior, s.matching)
        return self._judge(prior, found, solution, s.min_inliers, s.max_mahalanobis2)

    def localize_without_prior(
        self, local_map: FeatureSet, live: StereoFrame, guess: Uncertain | None = None
    ) -> LocalizationResult:
        """Pose of the live pair in a map of which only the neighbourhood is known.

        ``guess`` is ``T_map_live`` between optical frames; without it the camera stands about where the map's did,
        within ``search_distance`` and ``search_rotation``. The first pose found is confirmed by a second, narrow
        search from it, and more inliers are asked for than with a prior.
        """
        s = self.settings.localization
        if guess is None:
            guess = criteria.neighbourhood(s)
        everywhere = replace(s.matching, max_radius=float(self.camera.width), ransac_iterations=s.search_iterations)
        found, solution = self._measure(local_map, live, guess, everywhere)
        if solution is None or solution.inliers.sum() < s.search_first_inliers:
            return self._judge(guess, found, solution, s.search_first_inliers, np.inf)
        first = solution.T_live_map.inverse()
        narrow = Uncertain(first.T, first.covariance + np.diag(np.repeat([0.05, 0.01], 3) ** 2))
        found, solution = self._measure(local_map, live, narrow, s.matching)
        return self._judge(guess, found, solution, s.search_min_inliers, s.max_mahalanobis2)

    def _measure(
        self, local_map: FeatureSet, live: StereoFrame, prior: Uncertain, settings: MatchingSettings
    ) -> tuple[matching.Matches, solver.Solution | None]:
        T_live_map = prior.inverse()
        found = matching.match(local_map, live, T_live_map, self.camera, settings, self.settings.noise)
        chosen = local_map.landmarks[found.landmarks], local_map.covariances[found.landmarks]
        uvd = model.as_uvd(*chosen, self._intrinsics)
        # The prior guides the search and judges the outcome; the pose itself comes from the images alone, since a
        # prior that is fused again at every frame would count its own past as new evidence.
        return found, solver.solve(
            uvd, (found.uvd, found.noise), T_live_map.T, self._intrinsics, settings, rectification=self._rectification
        )

    def _judge(
        self,
        prior: Uncertain,
        found: matching.Matches,
        solution: solver.Solution | None,
        min_inliers: int,
        max_mahalanobis2: float,
    ) -> LocalizationResult:
        """Apply the criteria of success."""
        matches = len(found.landmarks)
        T_map_live, inliers, mahalanobis2 = prior, np.zeros(matches, dtype=np.bool_), float("nan")
        reason = f"no pose fits the {matches} landmarks that were found"
        if solution is not None:
            T_map_live, inliers = solution.T_live_map.inverse(), solution.inliers
            mahalanobis2 = T_map_live.mahalanobis2(prior)
            reason = _objection(
                solution,
                found,
                min_inliers,
                mahalanobis2 / max_mahalanobis2,
                self.camera.width,
                self.settings.localization,
            )
        if reason:
            T_map_live = prior
        return LocalizationResult(
            success=not reason,
            reason=reason,
            T_map_live=T_map_live,
            T_map_live_vehicle=in_vehicle_frames(T_map_live, self.camera.T_vehicle_camera),
            matches=matches,
            inliers=int(inliers.sum()),
            rms=solution.rms if solution else 0.0,
            mahalanobis2=mahalanobis2,
            inlier_landmarks=found.landmarks[inliers],
            inlier_places=found.uvd[inliers, :2],
        )


def _objection(
    solution: solver.Solution,
    found: matching.Matches,
    min_inliers: int,
    disagreement: float,
    width: int,
    settings: LocalizationSettings,
) -> str:
    """Why a pose is not to be believed, in one sentence; empty if it is."""
    if few := criteria.too_few(int(solution.inliers.sum()), len(found.landmarks), min_inliers, settings):
        return few
    places = found.uvd[solution.inliers, :2]
    spread = float(np.sqrt(np.linalg.eigvalsh(np.cov(places.T)).sum())) / width
    if spread < settings.min_spread:
        return f"the landmarks that agree lie within {100 * spread:.0f} % of the image's width"
    if uncertain := criteria.too_uncertain(solution.T_live_map.covariance, settings):
        return uncertain
    if not disagreement <= 1.0:
        return "the pose contradicts the prior"
    return ""
