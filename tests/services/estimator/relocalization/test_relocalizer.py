"""A place is found, or refused with a sentence: where it is unknown, ambiguous, or fits by chance."""

from __future__ import annotations

import numpy as np
import pytest

from common import geometry
from common.geometry import Uncertain
from services.estimator.pipeline import Localized
from services.estimator.relocalization import AppearanceIndex, Found, NotFound, Relocalizer, appearance_of
from services.estimator.stereo import StereoLocalizer, StereoSettings, local_map, preprocess
from tests.services.estimator.relocalization.network import STEP, Network, record, vertex
from tests.services.estimator.stereo.scene import CAMERA, render


@pytest.fixture
def network():
    network = Network()
    network.add_map(0, 40)
    network.add_map(1, 40, origin=(0.0, 100.0))
    return network


def test_the_robot_is_found_at_the_taught_vertex_nearest_to_it(network):
    found = network.find(vertex(1, 20), x=0.4)
    assert isinstance(found, Found)
    assert found.vertex == vertex(1, 21), "0.1 m away, where the one that looks the same is 0.4 m away"
    expected = geometry.from_xy_yaw(0.4 - STEP, 0.05, 0.02)
    np.testing.assert_allclose(found.T_vertex_live.T, expected, atol=1e-9)
    assert np.linalg.eigvalsh(found.T_vertex_live.covariance).min() > 0
    assert (found.inliers, found.stream) == (100, "plain")


def test_the_candidates_are_places_and_not_vertices_of_one_place(network):
    for index in range(40):
        looks = network.looks[vertex(0, index)]
        looks[:20] = network.looks[vertex(0, 20)][:20]
        network.index.add(vertex(0, index), {"plain": looks})
        network.inliers[vertex(0, index)] = 10
    network.find(vertex(0, 20))
    assert network.searched[0] == vertex(0, 20)
    metres = STEP * np.abs(np.diff(sorted(v.index for v in network.searched)))
    assert len(metres) >= 4
    assert metres.min() > 3.0


def test_what_looks_far_less_alike_is_not_looked_at(network):
    network.index.add(vertex(1, 5), {"plain": network.looks[vertex(0, 20)][:10]})
    network.find(vertex(0, 20))
    assert vertex(1, 5) not in network.searched
    network.inliers[vertex(0, 20)] = 10
    network.find(vertex(0, 20))
    assert vertex(1, 5) in network.searched, "unless the likest does not fit"


def test_what_a_repeat_recorded_finds_the_robot_in_the_taught_frame(network):
    network.add_map(2, 40, origin=(0.1, 0.2), generation=1)
    for index in range(40):
        network.join(vertex(2, index), vertex(0, index))
        network.inliers[vertex(0, index)] = 10
    found = network.find(vertex(2, 10), x=0.0)
    assert isinstance(found, Found)
    assert found.vertex == vertex(0, 10)
    np.testing.assert_allclose(found.T_vertex_live.T[:2, 3], [0.1, 0.25], atol=1e-9)


def test_look_alike_places_are_refused_and_both_are_named(network):
    network.add_map(2, 40, origin=(0.0, 500.0), like=0)
    at = geometry.from_xy_yaw(0.1, 0.05, 0.02)
    refused = network.find(vertex(0, 20), places={vertex(2, 20): at})
    assert isinstance(refused, NotFound)
    assert refused.reason.startswith("two places look alike")
    assert str(vertex(0, 20)) in refused.reason
    assert str(vertex(2, 20)) in refused.reason
    network.inliers[vertex(2, 20)] = 40
    found = network.find(vertex(0, 20), places={vertex(2, 20): at})
    assert isinstance(found, Found), "the other place fits far less well"


def test_two_maps_of_one_place_that_are_joined_are_no_look_alikes(network):
    network.add_map(2, 40, like=0)
    network.join(vertex(2, 3), vertex(0, 3))
    network.join(vertex(2, 20), vertex(0, 20))
    found = network.find(vertex(0, 20))
    assert isinstance(found, Found)


def test_an_unknown_place_is_refused(network):
    network.looks[vertex(0, 20)] = network.rng.integers(0, 256, (30, 32), dtype=np.uint8)
    refused = network.find(vertex(0, 20))
    assert isinstance(refused, NotFound)
    assert "nothing in environment 'yard' looks like" in refused.reason


def test_a_place_that_looks_right_and_fits_no_pose_is_refused(network):
    for name in network.inliers:
        network.inliers[name] = 10
    refused = network.find(vertex(0, 20))
    assert isinstance(refused, NotFound)
    assert "fits what the camera sees" in refused.reason


@pytest.mark.parametrize("wrong", ["none", "elsewhere"])
def test_a_fit_that_no_vertex_beside_it_shares_is_refused(network, wrong):
    for name in network.inliers:
        if name != vertex(0, 20):
            network.inliers[name] = 10 if wrong == "none" else 100
            network.offsets[name] = geometry.from_xy_yaw(0.8, 0, 0.4)
    refused = network.find(vertex(0, 20))
    assert isinstance(refused, NotFound)
    assert "no vertex beside it does" in refused.reason


def test_a_vertex_that_stands_alone_needs_no_neighbour():
    network = Network()
    network.add_map(0, 1)
    assert isinstance(network.find(vertex(0, 0)), Found)


def test_submaps_that_cannot_be_had_are_done_without(network):
    assert isinstance(network.find(vertex(0, 20), missing={vertex(0, 19), vertex(0, 21)}), Found)
    assert isinstance(network.find(vertex(0, 20), missing=set(network.poses)), NotFound)


def test_a_vertex_that_the_graph_does_not_know_yet_is_passed_over(network):
    stranger = vertex(7, 0)
    network.index.add(stranger, {"plain": network.looks[vertex(0, 20)]})
    assert isinstance(network.find(vertex(0, 20)), Found)


def test_a_camera_that_sees_nothing_is_told_so(network):
    network.looks[vertex(0, 20)] = np.zeros((0, 32), np.uint8)
    refused = network.find(vertex(0, 20))
    assert isinstance(refused, NotFound)
    assert "sees nothing" in refused.reason


class Rendered:
    """Two maps of three vertices each, of rendered images of one scene."""

    SETTINGS = StereoSettings()

    def __init__(self, *, joined):
        self.network = Network()
        self.localizer = StereoLocalizer(CAMERA, self.SETTINGS)
        self.submaps = {}
        for number in range(2):
            self.network.add_map(number, 3)
            for index in range(3):
                frame = self.frame(STEP * index, seed=10 * number + index)
                name = vertex(number, index)
                self.submaps[name] = local_map(frame.features, self.SETTINGS.mapping)
                self.network.index.add(name, appearance_of({"plain": self.submaps[name]}))
        if joined:
            self.network.join(vertex(0, 1), vertex(1, 1))

    def frame(self, z, x=0.0, seed=0):
        images = render(geometry.exp([x, 0.0, z, 0.0, 0.02, 0.0]), seed=seed)
        return preprocess(*images, 0, CAMERA, self.SETTINGS)

    def search(self, submap, live):
        result = self.localizer.localize_without_prior(submap, live)
        pose: Uncertain = result.T_map_live_vehicle
        return Localized(
            success=result.success, T_vertex_live=pose, inliers=result.inliers, stream="plain", reason=result.reason
        )

    def find(self, frame):
        relocalizer = Relocalizer(
            self.network.index, self.network.graph, self.search, lambda vs: {v: self.submaps[v] for v in vs}
        )
        return relocalizer.find(frame, appearance_of({"plain": frame.features}))


def test_images_of_a_joined_network_are_found_where_they_were_taken():
    rendered = Rendered(joined=True)
    found = rendered.find(rendered.frame(0.62, x=0.1, seed=50))
    assert isinstance(found, Found)
    assert found.vertex.index == 1
    forward, left = found.T_vertex_live.T[:2, 3]
    assert (forward, left) == pytest.approx((0.12, -0.1), abs=0.03)


def test_images_that_fit_two_places_alike_are_refused():
    rendered = Rendered(joined=False)
    refused = rendered.find(rendered.frame(0.62, x=0.1, seed=50))
    assert isinstance(refused, NotFound)
    assert "look alike" in refused.reason


def test_images_of_elsewhere_are_refused():
    rendered = Rendered(joined=True)
    texture = np.random.default_rng(1).integers(0, 256, (80, 120), dtype=np.uint8).repeat(4, 0).repeat(4, 1)
    other = preprocess(texture, np.roll(texture, -10, 1), 0, CAMERA, rendered.SETTINGS)
    assert len(other.features) > 50
    assert isinstance(rendered.find(other), NotFound)


def test_an_index_without_vertices_finds_nothing():
    network = Network()
    network.graph.add_experience(record(0))
    relocalizer = Relocalizer(AppearanceIndex(), network.graph, network.search, lambda _: {})
    assert isinstance(relocalizer.find(None, {"plain": np.ones((5, 32), np.uint8)}), NotFound)
