"""Where two maps meet is found near the end of the first; a longer route changes nothing about the robot's place."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from common import geometry
from common.geometry import Uncertain
from common.ids import VertexId
from services.estimator.chain import ChainSettings, LocalizationChain
from services.estimator.experiences import ExperienceSettings
from services.estimator.joints import JointBehind, JointSearch, JointSettings
from services.estimator.pipeline import Localized
from services.estimator.route_localizer import RouteLocalizer, WindowSettings
from services.estimator.route_map import RouteMap
from tests.services.estimator.driving import Drive

FIRST, NEXT = "20261122T204500000001-r1-00000a", "20261122T204500000002-r2-00000b"
STEP = 0.4
COUNT = 30
LAST = VertexId(FIRST, COUNT - 1)


@dataclass
class Place:
    """A submap: where a vertex truly is."""

    T_world_vertex: np.ndarray


class Pipeline:
    """Localizes by the truth, within 3 m and one standard deviation's reach of the prior, as a sensor would."""

    def __init__(self):
        self.T_world_live = np.eye(4)
        self.tried = []
        self.wrong = np.eye(4)
        self.inliers = 80

    def localize(self, submap, prior, _live):
        T = geometry.inverse(submap.T_world_vertex) @ self.T_world_live @ self.wrong
        self.tried.append(submap)
        near = np.linalg.norm(T[:3, 3]) < 3.0 and Uncertain.exactly(T).mahalanobis2(prior) < 33.0
        covariance = np.diag([1e-4] * 3 + [1e-5] * 3)
        return Localized(near, Uncertain(T, covariance) if near else prior, self.inliers, "plain", "")

    search = None


def straight(count):
    return np.stack([geometry.from_xy_yaw(STEP * k, 0, 0) for k in range(count)])


class Scene:
    """A robot that drives along a straight map, and another map that begins beside its end."""

    def __init__(self, gap, offset=0.0, yaw=0.0, settings=None):
        self.pipeline = Pipeline()
        self.T_last_next = geometry.from_xy_yaw(gap, offset, yaw)
        path = straight(COUNT)
        vertices = [VertexId(FIRST, k) for k in range(COUNT)]
        places = {v: Place(T) for v, T in zip(vertices, path, strict=True)}
        for k in range(6):
            T = path[-1] @ self.T_last_next @ geometry.from_xy_yaw(STEP * k, 0, 0)
            places[VertexId(NEXT, k)] = Place(T)
        route_map = RouteMap(vertices, path, self.pipeline, places.get, ExperienceSettings())
        self.localizer = RouteLocalizer(route_map, path, self.pipeline, ChainSettings(), WindowSettings())
        self.search = JointSearch(LAST, NEXT, self.pipeline, places.get, settings or JointSettings())
        self.drive = Drive()
        self.localizer.move(self.drive.on([0.0] * 6))
        self.localizer.start(None)
        self.localizer.chain.localize(Uncertain(np.eye(4), np.diag([1e-4] * 6)))
        self.path = path

    def run(self, metres=11.6):
        """Drives on, a tenth of a metre a frame; returns the edge that is found, and the metres left then."""
        for _ in range(round(metres / 0.1)):
            step = self.drive.on([0.1, 0, 0, 0, 0, 0])
            self.pipeline.T_world_live = self.pipeline.T_world_live @ geometry.from_xy_yaw(0.1, 0, 0)
            self.localizer.move(step)
            T_trunk_live = geometry.inverse(self.path[self.localizer.chain.trunk]) @ self.pipeline.T_world_live
            self.localizer.chain.localize(Uncertain(T_trunk_live, np.diag([1e-4] * 3 + [1e-5] * 3)))
            edge = self.search.look(self.localizer, step)
            if edge is not None:
                return edge, self.localizer.metres_left()
        return None, 0.0


@pytest.mark.parametrize(("gap", "offset", "yaw"), [(0.5, 0.0, 0.0), (1.5, 0.3, 0.2), (-1.0, -0.4, -0.25)])
def test_the_next_map_is_found_before_the_end(gap, offset, yaw):
    scene = Scene(gap, offset, yaw)
    edge, left = scene.run()
    assert edge is not None
    assert left > 0.5
    assert edge.a == LAST
    T_last_first = edge.T_a_b @ geometry.from_xy_yaw(-STEP * edge.b.index, 0, 0)
    assert np.allclose(T_last_first, scene.T_last_next, atol=1e-6)
    assert np.linalg.eigvalsh(edge.covariance).min() > 0.0
    assert scene.search.look(scene.localizer, scene.drive.on([0.0] * 6)) is None, "once is enough"


def test_a_map_that_begins_elsewhere_is_not_found():
    assert Scene(9.0, 9.0).run() == (None, 0.0)


def test_few_landmarks_join_nothing():
    scene = Scene(0.5)
    scene.pipeline.inliers = 29
    assert scene.run() == (None, 0.0)


def test_two_frames_that_disagree_join_nothing():
    scene = Scene(0.5)
    real = scene.pipeline.localize

    def deceived(submap, prior, live):
        scene.pipeline.wrong = geometry.from_xy_yaw(0.0, 0.2 * (len(scene.pipeline.tried) % 2), 0.0)
        return real(submap, Uncertain(prior.T, np.eye(6)), live)

    scene.pipeline.localize = deceived
    assert scene.run() == (None, 0.0)


def test_far_from_the_end_nothing_is_looked_for():
    scene = Scene(0.5, settings=JointSettings(ahead=2.0))
    scene.run(9.0)
    assert scene.pipeline.tried == []
    assert scene.search.wanted(scene.localizer) == []
    scene.run(1.0)
    assert scene.search.wanted(scene.localizer)[0] == VertexId(NEXT, 0)


def test_a_longer_route_keeps_the_robots_place():
    scene = Scene(0.5)
    scene.run(5.0)
    chain = scene.localizer.chain
    before = chain.trunk, chain.T_trunk_leaf().T, chain.metres_since_success, chain.localized
    longer = np.concatenate([scene.path, scene.path[-1] @ scene.T_last_next @ straight(6)])
    vertices = [*scene.localizer.map.vertices, *(VertexId(NEXT, k) for k in range(6))]
    assert scene.localizer.extend(vertices, longer)
    assert chain.trunk == before[0]
    assert np.array_equal(chain.T_trunk_leaf().T, before[1])
    assert (chain.metres_since_success, chain.localized) == before[2:]
    assert scene.localizer.metres_left() > 8.0
    assert not scene.localizer.extend(vertices[1:], longer[1:]), "another route is no longer one"


def test_the_chain_goes_on_over_the_joint():
    path = straight(10)
    chain, drive = LocalizationChain(path), Drive()
    chain.move(drive.on([0.0] * 6))
    chain.start(8)
    chain.extend(np.concatenate([path, straight(20)[12:]]))
    for _ in range(60):
        chain.move(drive.on([0.1, 0, 0, 0, 0, 0]))
    assert chain.trunk == len(path) + 8 - 1


def test_an_edge_found_at_a_standstill_is_composed_of_what_was_driven_since():
    drive = Drive()
    T_last_live = Uncertain(geometry.from_xy_yaw(0.1, 0, 0), np.diag([1e-4] * 6))
    behind = JointBehind(LAST, T_last_live, JointSettings())
    behind.move(drive.on([0.0] * 6))
    behind.move(drive.on([0.3, 0, 0, 0, 0, 0]))
    T_vertex_live = Uncertain(geometry.from_xy_yaw(-0.2, 0.1, 0), np.diag([1e-4] * 6))
    edge = behind.edge(VertexId(NEXT, 1), T_vertex_live)
    expected = geometry.from_xy_yaw(0.4, 0, 0) @ geometry.inverse(T_vertex_live.T)
    assert np.allclose(edge.T_a_b, expected, atol=1e-6)
    assert behind.edge(VertexId(FIRST, 3), T_vertex_live) is None
    for _ in range(60):
        behind.move(drive.on([0.1, 0, 0, 0, 0, 0]))
    assert behind.edge(VertexId(NEXT, 1), T_vertex_live) is None
