"""A loop closure is offered where two frames agree on a candidate, and only there."""

from dataclasses import dataclass

import numpy as np
import pytest

from common import geometry
from common.geometry import Uncertain
from common.ids import VertexId
from services.estimator.merging import ClosureSearch, ClosureSettings
from services.estimator.pipeline import Localized
from tests.services.estimator.driving import Drive

TAUGHT, OTHER = "20261122T204500000001-r1-00000a", "20261122T204500000002-r2-00000b"
NEAR, FAR = VertexId(OTHER, 3), VertexId(OTHER, 40)
LAST = VertexId(TAUGHT, 20)
STEP = 0.1


@dataclass
class Scene:
    """A robot that drives straight on, ``x`` metres beyond its map's last vertex, past a vertex of another map."""

    T_last_candidate: np.ndarray
    x: float = 0.0
    inliers: int = 80
    slip: float = 0.0

    def search(self, submap, _live):
        T_candidate_live = geometry.inverse(submap) @ geometry.from_xy_yaw(self.x + self.slip, 0, 0)
        near = np.linalg.norm(T_candidate_live[:3, 3]) < 1.5
        return Localized(near, Uncertain(T_candidate_live, np.eye(6) * 1e-4), self.inliers if near else 0, "plain", "")


def closures(scene, candidates=(NEAR, FAR), frames=20, settings=None):
    submaps = {NEAR: scene.T_last_candidate, FAR: geometry.from_xy_yaw(50, 0, 0)}
    search = ClosureSearch(candidates, scene, submaps.get, settings or ClosureSettings())
    drive = Drive()
    for _ in range(frames):
        step = drive.on([STEP, 0, 0, 0, 0, 0])
        scene.x += STEP
        here = Uncertain(geometry.from_xy_yaw(scene.x, 0, 0), np.eye(6) * 1e-4)
        found = search.look((LAST, here), step)
        if found is not None:
            yield found


def test_the_edge_leads_to_where_the_candidate_truly_is():
    truth = geometry.from_xy_yaw(1.2, 0.3, 0.4)
    found = next(closures(Scene(truth)))
    assert (found.edge.kind, found.edge.a, found.edge.b, found.inliers) == ("spatial", LAST, NEAR, 80)
    assert found.edge.T_a_b == pytest.approx(truth)
    assert np.linalg.eigvalsh(found.edge.covariance).min() > 0


def test_one_frame_alone_makes_no_offer():
    assert list(closures(Scene(geometry.from_xy_yaw(0.1, 0, 0)), (NEAR,), frames=1)) == []


def test_few_landmarks_make_no_offer():
    assert list(closures(Scene(geometry.from_xy_yaw(1, 0, 0), inliers=29))) == []


def test_frames_that_contradict_the_odometry_make_no_offer():
    class Jumping(Scene):
        def search(self, submap, live):
            self.slip += 0.3
            return super().search(submap, live)

    assert list(closures(Jumping(geometry.from_xy_yaw(1, 0, 0), slip=-2.0), (NEAR,), frames=8)) == []


def test_a_place_that_is_passed_by_nowhere_near_makes_no_offer():
    assert list(closures(Scene(geometry.from_xy_yaw(1, 30, 0)))) == []


def test_a_candidate_whose_submap_is_not_here_is_waited_for():
    scene = Scene(geometry.from_xy_yaw(1, 0, 0))
    search = ClosureSearch((NEAR,), scene, {}.get, ClosureSettings())
    step = Drive().on([STEP, 0, 0, 0, 0, 0])
    assert search.look((LAST, Uncertain.identity()), step) is None
