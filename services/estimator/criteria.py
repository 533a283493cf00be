"""What a pose in a map must meet to be believed, whichever sensor it was measured with."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from common.geometry import Array, Uncertain


@dataclass(frozen=True, slots=True)
class CriteriaSettings:
    """When a localization is believed, and how far from a vertex it is looked for without a prior.

    Attributes:
        min_inliers: fewer is a failure.
        min_inlier_ratio: least part of the matches that agree.
        max_position_sigma: largest standard deviation of the position, metres, along the worst axis.
        max_rotation_sigma: largest standard deviation of the rotation, radians, about the worst axis.
        max_mahalanobis2: largest squared Mahalanobis distance to the prior, 6 degrees of freedom.
        search_distance: standard deviation of the position assumed without a prior, metres.
        search_rotation: likewise of the rotation, radians.
        search_iterations: most minimal samples drawn without a prior.
        search_min_inliers: least inliers, where the prior says next to nothing.
    """

    min_inliers: int = 20
    min_inlier_ratio: float = 0.15
    max_position_sigma: float = 0.15
    max_rotation_sigma: float = 0.03
    max_mahalanobis2: float = 33.0
    search_distance: float = 1.0
    search_rotation: float = 0.3
    search_iterations: int = 2000
    search_min_inliers: int = 25


def neighbourhood(settings: CriteriaSettings) -> Uncertain:
    """Where a sensor is assumed in a map without a prior: about where the map's was."""
    sigma = np.repeat([settings.search_distance, settings.search_rotation], 3)
    return Uncertain(np.eye(4), np.diag(sigma**2))


def too_few(agree: int, matches: int, min_inliers: int, settings: CriteriaSettings) -> str:
    """Why so few matches that agree are not to be believed, in one sentence; empty if they are enough."""
    if agree < min_inliers:
        return f"only {agree} landmarks agree on the pose, {min_inliers} are needed"
    if agree < settings.min_inlier_ratio * matches:
        return f"only {agree} of {matches} landmarks agree on the pose"
    return ""


def too_uncertain(covariance: Array, settings: CriteriaSettings) -> str:
    """Why a pose of this covariance (6, 6) is not to be believed, in one sentence; empty if it is exact enough."""
    position, rotation = (
        float(np.sqrt(np.linalg.eigvalsh(block)[-1])) for block in (covariance[:3, :3], covariance[3:, 3:])
    )
    if position <= settings.max_position_sigma and rotation <= settings.max_rotation_sigma:
        return ""
    return f"the pose is uncertain by {position:.2f} m and {np.degrees(rotation):.1f} degrees"
