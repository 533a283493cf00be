"""``[estimator.bearing]``: the camera's rough field of view, the images that are kept, and the particle filter."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated

from pydantic import Field

Positive = Annotated[float, Field(gt=0)]


@dataclass(frozen=True, slots=True)
class ParticleSettings:
    """The particle filter over distance along the map and heading offset.

    Attributes:
        count: particles.
        distance_noise: standard deviation of the distance driven, metres after one metre; it grows with the root of the
            way. Wheels that slip by 1.5 % for two metres at a time, in the teach and in the repeat, make as much.
        heading_noise: likewise of the heading offset, radians after one metre: slip, and parallax that changes.
        temperature: difference of similarity that makes a place e times as likely, as in ``common.registration``.
        independence: metres between two images whose errors have nothing in common; those of nearer ones count less.
        reach: metres beyond the last image at hand at which similarity has fallen to 60 %.
        fresh: part of the particles that each metre sets anew where the live image alone would have them.
        effective: part of the particles that weigh, below which they are drawn anew.
    """

    count: Annotated[int, Field(ge=50, le=20_000)] = 500
    distance_noise: Positive = 0.04
    heading_noise: Positive = 0.04
    temperature: Positive = 0.02
    independence: Positive = 1.0
    reach: Positive = 1.0
    fresh: Annotated[float, Field(ge=0, lt=1)] = 0.1
    effective: Annotated[float, Field(gt=0, lt=1)] = 0.5


@dataclass(frozen=True, slots=True)
class BearingSettings:
    """Teach and repeat by bearing alone.

    Attributes:
        field_of_view: of the camera from side to side, radians. A guess will do: it scales pixels to radians, and so
            the strength of the correction, and its error moves no place at which the correction vanishes.
        model: ONNX file of a network that represents images; gradients are the representation without one.
        width: working width of the gradients' representation, pixels.
        skip_top: part of an image's height, from the top, that is left out: what is far tells the heading, but hardly
            the way back to the path.
        max_shift: largest shift between two images that is looked for, in widths of the image.
        distance, rotation: metres and radians after which the next image is kept.
        search: metres around the assumed place in which a robot that starts may stand.
        search_sigma: standard deviation of the distance found, metres, beyond which a search has not found it.
        search_heading: largest heading offset that a search considers, radians.
        least_contrast: standard deviations by which the similarity at the robot's place stands out of that at all
            shifts, for an image to count.
        images: stored images that a live one is compared with at most.
        lost_sigma: standard deviation of the distance, metres, beyond which the robot is not localized any more.
        actions_ahead, actions_behind: metres of taught actions that are told around the robot.
    """

    field_of_view: Annotated[float, Field(gt=0.1, lt=3.0)] = 1.2
    model: str = ""
    width: Annotated[int, Field(ge=64, le=2048)] = 256
    skip_top: Annotated[float, Field(ge=0, lt=0.9)] = 0.0
    max_shift: Annotated[float, Field(gt=0.05, lt=0.9)] = 0.4
    distance: Positive = 0.4
    rotation: Positive = 0.2
    search: Positive = 3.0
    search_sigma: Positive = 0.8
    search_heading: Positive = 0.5
    least_contrast: float = 2.0
    images: Annotated[int, Field(ge=2, le=50)] = 8
    lost_sigma: Positive = 1.0
    actions_ahead: Positive = 2.0
    actions_behind: Positive = 0.5
    particles: ParticleSettings = field(default_factory=ParticleSettings)
