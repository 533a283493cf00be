import numpy as np
import pytest

from common import geometry
from services.estimator.vertex_creation import VertexCreationSettings, should_create

SETTINGS = VertexCreationSettings(distance=0.4, rotation=0.175, min_inliers=40)


@pytest.mark.parametrize(
    ("distance", "rotation", "inliers", "due"),
    [
        (0.0, 0.0, 200, False),
        (0.39, 0.17, 200, False),
        (0.41, 0.0, 200, True),
        (0.0, 0.18, 200, True),
        (0.15, 0.0, 200, False),
        (0.15, 0.0, 20, True),
        (0.05, 0.0, 0, False),
    ],
)
def test_a_vertex_is_due_by_distance_rotation_or_need(distance, rotation, inliers, due):
    T = geometry.transform(geometry.so3_exp([0.0, 0.0, rotation]), np.array([distance, 0.0, 0.0]))
    assert should_create(T, inliers, SETTINGS) is due
