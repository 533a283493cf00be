"""Fourth stage, vertex creation: when the live frame becomes a vertex of the pose graph."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from common import geometry
from services.estimator.stereo.settings import VertexCreationSettings


def should_create(T_vertex_live: NDArray[np.float64], inliers: int, settings: VertexCreationSettings) -> bool:
    """Whether a vertex is due, given the motion since the last one (4, 4) and the inliers of the odometry.

    Due by distance, by rotation, or, where matches grow few, at a quarter of either.
    """
    near = 0.25 if inliers < settings.min_inliers else 1.0
    distance = float(np.linalg.norm(T_vertex_live[:3, 3]))
    rotation = float(geometry.rotation_angle(T_vertex_live))
    return bool(distance >= near * settings.distance or rotation >= near * settings.rotation)
