"""Everything that can be set in the stereo pipeline, with its unit. The defaults suit 0.25 to 1.5 megapixels."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated

from pydantic import Field

from services.estimator.criteria import CriteriaSettings
from services.estimator.motion_model import MotionSettings
from services.estimator.vertex_creation import VertexCreationSettings


@dataclass(frozen=True, slots=True)
class NoiseSettings:
    """Standard deviations of what the images measure.

    Attributes:
        pixel: of a feature's place in the left image after refinement, pixels, along each axis, beside what the
            patch's fit says.
        disparity: of the disparity after refinement, pixels, beside what the patch's fit says. A landmark's depth
            error follows from it: it grows with the square of the depth.
        landmark_pixel: of a stored feature's place, pixels: its patch is what defines the place, so little is left.
        disparity_offset: error of the calibration's disparities that all features share, pixels.
        disparity_curvature: and the part of it that grows with the square of the distance from the image's middle,
            pixels per unit of ``((u - cx) / fx)^2``.
        rectification_walk: change of the two from keyframe to keyframe, as a part of the two.
        detection: of a detected corner about the place where the landmark truly projects, pixels; widens the search
            before refinement.
        detection_disparity: of its disparity, pixels, likewise.
        parallax: error of a refined place per unit of relative change of depth between the two views, pixels: a patch
            seen from nearer or farther is not the same patch.
    """

    pixel: float = 0.06
    disparity: float = 0.06
    landmark_pixel: float = 0.05
    disparity_offset: float = 0.4
    disparity_curvature: float = 1.0
    rectification_walk: float = 0.02
    detection: float = 1.0
    detection_disparity: float = 0.5
    parallax: float = 0.3


@dataclass(frozen=True, slots=True)
class InvarianceSettings:
    """The illumination-invariant stream of a colour camera.

    Attributes:
        enabled: whether it runs beside the plain stream.
        alpha, beta: weights of blue and red; None: from the camera's peak wavelengths.
        black_level: grey level of no light.
        floor: intensity, as a part of full scale, that is added before the logarithm: about the sensor's noise.
        contrast: grey levels a unit of the invariant intensity.
        smoothing: standard deviation of the smoothing before and after, pixels: the logarithms of three noisy channels
            are noisier than any of them.
    """

    enabled: bool = True
    alpha: float | None = None
    beta: float | None = None
    black_level: Annotated[float, Field(ge=0, le=200)] = 0.0
    floor: Annotated[float, Field(gt=0, le=1)] = 0.01
    contrast: Annotated[float, Field(gt=0, le=5000)] = 250.0
    smoothing: Annotated[float, Field(ge=0, le=2)] = 1.0


@dataclass(frozen=True, slots=True)
class PreprocessingSettings:
    """From images to features.

    Attributes:
        fast_threshold: contrast of a FAST corner, grey levels.
        cell: side of the square cells over which features are spread, pixels.
        max_features: most corners of the left image that are matched, and so most features of a frame.
        max_disparity: largest disparity searched for, pixels.
        min_disparity: smallest disparity kept, pixels: nearer to zero depth is unbounded.
        row_tolerance: largest vertical offset of a correspondence, pixels, which allows for imperfect rectification.
        min_correlation: least zero-mean normalised cross-correlation of the patches of a stereo correspondence.
        uniqueness: the best correspondence's ``1 - correlation`` must be below this part of the second best's.
    """

    fast_threshold: int = 10
    cell: int = 40
    max_features: int = 1200
    max_disparity: float = 160.0
    min_disparity: float = 0.7
    row_tolerance: float = 1.5
    min_correlation: float = 0.85
    uniqueness: float = 0.8


@dataclass(frozen=True, slots=True)
class MatchingSettings:
    """Active search, sub-pixel refinement, consensus and the solve, as odometry and localization share them.

    Attributes:
        gate: a feature is a candidate within this many standard deviations of the predicted measurement.
        max_radius: largest half side of a search region, pixels.
        max_hamming: most differing bits, of 256, of two descriptors that match.
        ratio: the best candidate's distance must be below this part of the second best's.
        refine_iterations: most steps of the sub-pixel alignment.
        max_refine_shift: a patch that moves farther than this from its corner has not converged, pixels.
        min_correlation: least correlation of a refined patch with the landmark's.
        ransac_iterations: most minimal samples drawn.
        inlier_gate: largest standardised error of an inlier, in standard deviations of its stereo measurement.
        solver_iterations: most steps of the robust solve.
        robust_scale: standardised error at which Geman-McClure's weight has fallen to a quarter.
        max_matches: most matches that are refined and solved for; the nearest landmarks are preferred.
    """

    gate: float = 3.5
    max_radius: float = 150.0
    max_hamming: int = 70
    ratio: float = 0.85
    refine_iterations: int = 10
    max_refine_shift: float = 2.5
    min_correlation: float = 0.75
    ransac_iterations: int = 100
    inlier_gate: float = 4.0
    solver_iterations: int = 12
    robust_scale: float = 3.0
    max_matches: int = 500


@dataclass(frozen=True, slots=True)
class OdometrySettings(MotionSettings):
    """Motion prior, keyframes and what counts as success.

    Attributes:
        matching: search, refinement and solve.
        min_inliers: fewer is a failure.
        min_inlier_ratio: least part of the matches that agree.
        keyframe_inliers: below this many inliers the live frame becomes the keyframe.
        keyframe_overlap: and below this part of the keyframe's landmarks found again.
        keyframe_distance: and beyond this distance from the keyframe, metres.
        keyframe_rotation: and beyond this rotation, radians.
        keyframe_growth: and when the standard deviation of the position has grown by this factor since the first pair
            that was matched against it.
        max_failures: after as many failures in a row the live frame becomes the keyframe, its motion unmeasured.
    """

    matching: MatchingSettings = field(default_factory=MatchingSettings)
    min_inliers: int = 15
    min_inlier_ratio: float = 0.3
    keyframe_inliers: int = 60
    keyframe_overlap: float = 0.2
    keyframe_distance: float = 3.0
    keyframe_rotation: float = 0.2
    keyframe_growth: float = 3.0
    max_failures: int = 5


@dataclass(frozen=True, slots=True)
class BundleSettings:
    """Bundle adjustment over a sliding window of keyframes.

    Attributes:
        enabled: whether it runs beside odometry. It does not by default: on the recordings and in the synthetic world
            odometry without it drifts as little, and is steadier from frame to frame.
        refine_landmarks: whether odometry goes on with the newest keyframe's landmarks as the window sees them, beside
            its pose. They carry the window's own motion into the motions measured against them, so that errors of
            scale feed themselves: off, unless a rig's single pairs say too little of depth.
        keyframes: how many the window holds.
        max_landmarks: most landmarks of a window; those that were seen most often are preferred.
        min_correlation: least correlation of a landmark's first patch with a later keyframe's image.
        gate: a measurement farther than this from its prediction is left out, pixels.
        iterations: most steps.
        robust_scale: standardised error at which Geman-McClure's weight has fallen to a quarter.
    """

    enabled: bool = False
    refine_landmarks: bool = False
    keyframes: int = 5
    max_landmarks: int = 400
    min_correlation: float = 0.8
    gate: float = 3.0
    iterations: int = 6
    robust_scale: float = 3.0


@dataclass(frozen=True, slots=True)
class MappingSettings:
    """Local maps.

    Attributes:
        max_landmarks: most landmarks of a vertex, which bounds what it takes on disk (about 0.25 kB each).
    """

    max_landmarks: int = 600


@dataclass(frozen=True, slots=True)
class LocalizationSettings(CriteriaSettings):
    """Localisation against a map.

    Attributes:
        matching: search, refinement and solve.
        min_spread: least standard deviation of the inliers' places, as a part of the image's width.
        rectification: how far the disparity's error may differ between the map and the live pair, as a part of the
            calibration's: the rig that made the map, on its day, was not quite the live one.
        search_first_inliers: least inliers of the first, wide search, that are worth a second, narrow one.
    """

    matching: MatchingSettings = field(default_factory=lambda: MatchingSettings(ratio=0.9))
    min_inliers: int = 15
    min_inlier_ratio: float = 0.25
    min_spread: float = 0.06
    rectification: float = 0.5
    search_first_inliers: int = 10
    search_min_inliers: int = 20


@dataclass(frozen=True, slots=True)
class StereoSettings:
    """All stages of the pipeline."""

    noise: NoiseSettings = field(default_factory=NoiseSettings)
    invariance: InvarianceSettings = field(default_factory=InvarianceSettings)
    preprocessing: PreprocessingSettings = field(default_factory=PreprocessingSettings)
    odometry: OdometrySettings = field(default_factory=OdometrySettings)
    bundle: BundleSettings = field(default_factory=BundleSettings)
    mapping: MappingSettings = field(default_factory=MappingSettings)
    vertex_creation: VertexCreationSettings = field(default_factory=VertexCreationSettings)
    localization: LocalizationSettings = field(default_factory=LocalizationSettings)
