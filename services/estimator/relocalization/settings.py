"""What recognises a place, how many are looked at, and what makes one certain."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from pydantic import Field

from services.estimator.relocalization.appearance import STORED

Positive = Annotated[float, Field(gt=0)]
AtLeastOne = Annotated[int, Field(ge=1)]


@dataclass(frozen=True, slots=True)
class RelocalizationSettings:
    """Relocalisation without a prior.

    Attributes:
        descriptors: most of a vertex, by stream, that are indexed.
        query_descriptors: most of the live frame that are looked up, by stream.
        max_distance: differing bits, of 256, up to which two descriptors count as alike.
        max_bucket: descriptors that share a key of 16 bits beyond which that key tells nothing apart.
        max_vertices: of an environment whose index would hold more, those recorded in repeats are left out, the oldest
            first. A vertex takes about 20 kB of memory for each stream.
        candidates: distinct places that are looked at more closely.
        rival_likeness: a candidate that looks less alike than this part of one that fits is not looked at any more.
        place_radius: metres along the pose graph within which vertices are one place.
        reach: metres along the pose graph within which vertices must agree on where the robot stands.
        neighbours: vertices beside the one found of which one has to agree.
        agreement: metres, and half as many radians, by which two vertices may differ about the robot's pose.
        rival: another place is as likely where it has at least this part of the best one's inliers.
        period_s: between two looks for new vertices while the robot is idle, seconds.
        store_s: deadline of the map store's answers, seconds.
    """

    descriptors: AtLeastOne = STORED
    query_descriptors: AtLeastOne = 250
    max_distance: Annotated[int, Field(ge=0, le=256)] = 48
    max_bucket: AtLeastOne = 1000
    max_vertices: AtLeastOne = 5000
    candidates: AtLeastOne = 12
    rival_likeness: Annotated[float, Field(ge=0, le=1)] = 0.7
    place_radius: Positive = 3.0
    reach: Positive = 8.0
    neighbours: AtLeastOne = 4
    agreement: Positive = 0.5
    rival: Annotated[float, Field(gt=0, le=1)] = 0.5
    period_s: Positive = 5.0
    store_s: Positive = 2.0
