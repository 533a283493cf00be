"""Fourth stage, vertex creation: when the live frame becomes a vertex of the pose graph."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from common import geometry


@dataclass(frozen=True, slots=True)
class VertexCreationSettings:
    """When a new vertex is made.

    Attributes:
        distance: from the last vertex, metres.
        rotation: from the last vertex, radians.
        min_inliers: below this many odometry inliers a vertex is made earlier, at a quarter of the distance.
    """

    distance: float = 0.4
    rotation: float = 0.175
    min_inliers: int = 40


def should_create(T_vertex_live: NDArray[np.float64], inliers: int, settings: VertexCreationSettings) -> bool:
    """Whether a vertex is due, given the motion since the last one (4, 4) and the inliers of the odometry.

    Due by distance, by rotation, or, where matches grow few, at a quarter of either.
    """
    near = 0.25 if inliers < settings.min_inliers else 1.0
    distance = float(np.linalg.norm(T_vertex_live[:3, 3]))
    rotation = float(geometry.rotation_angle(T_vertex_live))
    return bool(distance >= near * settings.distance or rotation >= near * settings.rotation)
