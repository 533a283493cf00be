"""Pose without a useful prior: the best few consensuses, each refined by a narrow search around it, and judged.

Where nearly every landmark is a candidate for every keypoint, chance, and what moves with the vehicle, can bring as
many matches together as the truth does. So it is not the matches that choose, but the ranges (:mod:`agreement`).
"""

from __future__ import annotations

import numpy as np

from common.geometry import Uncertain
from services.estimator.lidar import matching, solver
from services.estimator.lidar.agreement import RangeImage
from services.estimator.lidar.features import Landmarks, LidarFeatures
from services.estimator.lidar.matching import Matches
from services.estimator.lidar.settings import MatchingSettings

_CONSENSUSES = 3
_NARROW = np.diag(np.repeat([0.05, 0.01], 3) ** 2)
"""Covariance that is added to that of a pose that is to be confirmed: metres and radians."""


def search(
    landmarks: Landmarks,
    live: LidarFeatures,
    ranges: RangeImage,
    guess: Uncertain,
    settings: MatchingSettings,
    wide: MatchingSettings,
) -> tuple[Matches, solver.Solution | None]:
    """The pose that agrees best with the live scan's ranges, and the matches that it was solved from.

    ``guess`` is ``T_live_map`` with a wide covariance, ``wide`` the settings of the first search, ``settings`` those of
    the second.
    """
    found = matching.match(landmarks, live, guess, wide)
    best, best_found, most = None, found, 0.0
    for _ in range(_CONSENSUSES):
        first = solver.solve_matches(landmarks, live, found, guess.T, wide)
        if first is None:
            break
        narrow = Uncertain(first.T_live_map.T, first.T_live_map.covariance + _NARROW)
        again = matching.match(landmarks, live, narrow, settings)
        confirmed = solver.solve_matches(landmarks, live, again, narrow.T, settings)
        agreement = 0.0 if confirmed is None else ranges.agreement(landmarks.points, confirmed.T_live_map.T)
        if agreement > most:
            best, best_found, most = confirmed, again, agreement
        found = Matches(found.landmarks[~first.inliers], found.features[~first.inliers])
    return best_found, best
