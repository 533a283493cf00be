"""Everything that can be set in the lidar pipeline, with its unit. The defaults suit 32 to 128 beams."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated

from pydantic import Field

from services.estimator.criteria import CriteriaSettings
from services.estimator.motion_model import MotionSettings
from services.estimator.surf import SurfSettings
from services.estimator.vertex_creation import VertexCreationSettings


@dataclass(frozen=True, slots=True)
class ImageSettings:
    """From a scan to a stack of images.

    Attributes:
        min_range, max_range: points outside are left out, metres: nearer is the vehicle itself.
        contrast: grey levels to a standard deviation of a row's brightness.
        support: half side of a keypoint's surroundings, pixels of the detection image.
        min_support: least part of them that is measured and not filled in.
    """

    min_range: Annotated[float, Field(ge=0)] = 1.5
    max_range: Annotated[float, Field(gt=0)] = 120.0
    contrast: Annotated[float, Field(gt=0, le=128)] = 45.0
    support: Annotated[int, Field(ge=1, le=100)] = 10
    min_support: Annotated[float, Field(ge=0, le=1)] = 0.85


@dataclass(frozen=True, slots=True)
class NoiseSettings:
    """Standard deviations of what a scan measures.

    Attributes:
        pixel: of a keypoint's place, pixels of the detection image, along each axis.
        range: of a range, metres, beside what the surface around the keypoint says.
    """

    pixel: float = 1.0
    range: float = 0.03


@dataclass(frozen=True, slots=True)
class KeypointSettings:
    """Metric keypoints.

    Attributes:
        surf: detector and descriptor; upright, for the vehicle and its lidar stand upright, and spread over the image.
        half_width, half_height: of the window of the stack that a keypoint's measurement is fitted in, pixels.
        min_filled: least part of that window that holds measurements.
        max_roughness: largest root mean square distance of the window's ranges from a plane, metres.
        max_relative_roughness: and as a part of the range; the larger of the two counts.
    """

    surf: SurfSettings = field(default_factory=lambda: SurfSettings(upright=True, cell=40))
    half_width: int = 2
    half_height: int = 1
    min_filled: float = 0.6
    max_roughness: float = 0.10
    max_relative_roughness: float = 0.01


@dataclass(frozen=True, slots=True)
class MatchingSettings:
    """Active search, consensus and the solve, as odometry and localization share them.

    Attributes:
        gate: a keypoint is a candidate within this many standard deviations of the predicted measurement.
        max_radius: largest half side of a search region, radians.
        max_distance: largest distance of two unit descriptors that match.
        ratio: the best candidate's distance must be below this part of the second best's.
        ransac_iterations: most minimal samples drawn.
        inlier_gate: largest standardised error of an inlier.
        solver_iterations: most steps of the robust solve.
        robust_scale: standardised error at which Geman-McClure's weight has fallen to a quarter.
    """

    gate: float = 3.5
    max_radius: float = 0.5
    max_distance: float = 0.5
    ratio: float = 0.85
    ransac_iterations: int = 400
    inlier_gate: float = 3.0
    solver_iterations: int = 15
    robust_scale: float = 2.5


@dataclass(frozen=True, slots=True)
class OdometrySettings(MotionSettings):
    """Motion prior, keyframes and what counts as success.

    Attributes:
        matching: search, consensus and solve.
        compensate: whether motion within a turn is corrected.
        min_inliers: fewer is a failure.
        min_inlier_ratio: least part of the matches that agree.
        min_agreement: least part of the map's landmarks in view that lie on a surface of the live scan: of a true pose
            it is 0.6 and more, even where much is hidden.
        keyframe_inliers: below this many inliers the live scan becomes the keyframe.
        keyframe_distance: and beyond this distance from the keyframe, metres.
        keyframe_rotation: and beyond this rotation, radians.
        max_failures: after as many failures in a row the live scan becomes the keyframe, its motion unmeasured.
    """

    matching: MatchingSettings = field(default_factory=MatchingSettings)
    compensate: bool = True
    min_inliers: int = 20
    min_inlier_ratio: float = 0.15
    min_agreement: float = 0.5
    keyframe_inliers: int = 40
    keyframe_distance: float = 3.0
    keyframe_rotation: float = 0.3
    max_failures: int = 5


@dataclass(frozen=True, slots=True)
class MappingSettings:
    """Local maps.

    Attributes:
        max_landmarks: most landmarks of a vertex, which bounds what it takes on disk (about 0.1 kB each).
    """

    max_landmarks: int = 600


@dataclass(frozen=True, slots=True)
class LocalizationSettings(CriteriaSettings):
    """Localisation against a map.

    Attributes:
        matching: search, consensus and solve.
        min_agreement: least part of the map's landmarks in view that lie on a surface of the live scan: of a true pose
            it is 0.6 and more, even where much is hidden.
    """

    matching: MatchingSettings = field(default_factory=MatchingSettings)
    min_agreement: float = 0.5


@dataclass(frozen=True, slots=True)
class LidarSettings:
    """All stages of the pipeline."""

    image: ImageSettings = field(default_factory=ImageSettings)
    noise: NoiseSettings = field(default_factory=NoiseSettings)
    keypoints: KeypointSettings = field(default_factory=KeypointSettings)
    odometry: OdometrySettings = field(default_factory=OdometrySettings)
    mapping: MappingSettings = field(default_factory=MappingSettings)
    vertex_creation: VertexCreationSettings = field(default_factory=VertexCreationSettings)
    localization: LocalizationSettings = field(default_factory=LocalizationSettings)
