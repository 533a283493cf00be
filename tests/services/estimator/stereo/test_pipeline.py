"""Two streams, one estimate: the plain one's whenever it localizes, else the invariant one's."""

import threading
from dataclasses import replace

import numpy as np
import pytest

from common import geometry
from common.geometry import Uncertain
from common.ids import VertexId, new_map_id
from common.messages import VertexRecord
from services.estimator.stereo import FeatureError, StereoSettings
from services.estimator.stereo.pipeline import StereoPipeline
from services.estimator.stereo.streams import INVARIANT, PLAIN
from tests.services.estimator.stereo.scene import CAMERA, render

VERTEX = VertexId(new_map_id("r1", 1), 0)
T_CAMERA = CAMERA.T_vehicle_camera
ASIDE = geometry.exp([0.1, 0.0, 0.12, 0.0, 0.02, 0.0])
PRIOR = Uncertain(np.eye(4), np.diag(np.repeat([0.2, 0.05], 3) ** 2))


def colours(grey, tint, *, isoluminant=False):
    """A colour image whose green stands out by the texture; without any contrast in grey if isoluminant."""
    t = grey.astype(np.float64) / 255.0
    if isoluminant:
        green = 90 + 80 * t
        rest = (140 - 0.587 * green) / 0.413
        return np.rint(np.stack([rest, green, rest], -1)).astype(np.uint8)
    return np.rint(np.stack([tint * t * 200, t * 220, 120 + 0 * t], -1)).clip(0, 255).astype(np.uint8)


def pair(T=None, *, seed=0, **look):
    return [colours(image, 0.9, **look) for image in render(np.eye(4) if T is None else T, seed=seed)]


def pipeline(**options):
    return StereoPipeline(CAMERA, StereoSettings(), **options)


def submap_of(made, images):
    live = made.process(*images, 0).live
    return made.read(VertexRecord(id=VERTEX, stamp=0, keyframe=made.keyframe(live)))


def vehicle(T_left):
    return T_CAMERA @ T_left @ geometry.inverse(T_CAMERA)


def test_a_colour_pair_is_seen_by_both_streams_and_the_plain_one_is_taken():
    made = pipeline()
    submap = submap_of(made, pair())
    result = made.localize(submap, PRIOR, made.process(*pair(ASIDE, seed=5), 1).live)
    assert result.success
    assert result.stream == PLAIN
    assert {name: found.success for name, found in result.streams.items()} == {PLAIN: True, INVARIANT: True}
    assert np.allclose(result.T_vertex_live.T, vehicle(ASIDE), atol=0.03)
    assert result.members == (result.inliers,)


@pytest.mark.parametrize("by_prior", [True, False])
def test_where_grey_shows_nothing_the_invariant_stream_localizes(by_prior):
    made = pipeline()
    submap = submap_of(made, pair(isoluminant=True))
    live = made.process(*pair(ASIDE, seed=5, isoluminant=True), 1).live
    result = made.localize(submap, PRIOR, live) if by_prior else made.search(submap, live)
    assert result.success
    assert result.stream == INVARIANT
    assert not result.streams[PLAIN].success
    assert np.allclose(result.T_vertex_live.T, vehicle(ASIDE), atol=0.05)


def test_a_grey_camera_has_one_stream_and_says_so():
    made = pipeline()
    images = render(np.eye(4))
    assert "grey" in made.streams_of(images[0])
    assert set(made.process(*images, 0).live) == {PLAIN}
    assert "alpha" in made.streams_of(pair()[0])
    off = StereoPipeline(
        CAMERA, replace(StereoSettings(), invariance=replace(StereoSettings().invariance, enabled=False))
    )
    assert set(off.process(*pair(), 0).live) == {PLAIN}


def test_a_thread_of_its_own_changes_no_result():
    alone, beside = pipeline(), pipeline(parallel=True)
    results = []
    for made in (alone, beside):
        submap = submap_of(made, pair())
        results.append(made.localize(submap, PRIOR, made.process(*pair(ASIDE, seed=5), 1).live))
    beside.close()
    assert np.array_equal(results[0].T_vertex_live.T, results[1].T_vertex_live.T)
    assert results[0].streams == results[1].streams


def test_a_colour_camera_localizes_on_a_grey_map_and_the_other_way_round():
    made = pipeline()
    grey, colour = render(np.eye(4)), [np.repeat(image[..., None], 3, -1) for image in render(ASIDE, seed=5)]
    submap = submap_of(made, grey)
    assert made.localize(submap, PRIOR, made.process(*colour, 1).live).success
    submap = submap_of(made, [np.repeat(image[..., None], 3, -1) for image in grey])
    assert made.localize(submap, PRIOR, made.process(*render(ASIDE, seed=6), 2).live).success


def test_joined_submaps_localize_in_the_frame_of_the_first():
    made = pipeline()
    second = geometry.exp([-0.15, 0.0, 0.3, 0.0, -0.03, 0.0])
    blank = submap_of(made, [np.full((CAMERA.height, CAMERA.width), 90, np.uint8)] * 2)
    other = submap_of(made, pair(second, seed=7))
    T = Uncertain(vehicle(second), np.eye(6) * 1e-6)
    joint = made.join([(blank, Uncertain.identity()), (other, T)])
    assert joint.size == 2
    result = made.localize(joint, PRIOR, made.process(*pair(ASIDE, seed=5), 1).live)
    assert result.success
    assert np.allclose(result.T_vertex_live.T, vehicle(ASIDE), atol=0.04)
    assert result.members == (0, result.inliers)


def test_a_vertex_whose_place_is_vague_makes_a_vague_estimate():
    made = pipeline()
    other = submap_of(made, pair())
    empty = submap_of(made, [np.full((CAMERA.height, CAMERA.width), 90, np.uint8)] * 2)
    live = made.process(*pair(ASIDE, seed=5), 1).live
    sure, vague = (
        made.localize(
            made.join([(empty, Uncertain.identity()), (other, Uncertain(np.eye(4), np.eye(6) * v))]), PRIOR, live
        )
        for v in (1e-8, 1e-3)
    )
    assert np.trace(vague.T_vertex_live.covariance) > np.trace(sure.T_vertex_live.covariance)


def test_a_keyframe_that_is_not_whole_is_refused():
    made = pipeline()
    keyframe = made.keyframe(made.process(*pair(), 0).live)
    arrays = {name: array for name, array in keyframe.arrays.items() if name != f"{INVARIANT}/patches"}
    with pytest.raises(FeatureError, match="patches"):
        made.read(VertexRecord(id=VERTEX, stamp=0, keyframe=keyframe.model_copy(update={"arrays": arrays})))


def test_with_bundle_adjustment_beside_it_the_motion_is_measured_and_closing_ends_its_thread():
    settings = StereoSettings()
    settings = replace(settings, bundle=replace(settings.bundle, enabled=True))
    before = {thread.ident for thread in threading.enumerate()}
    made = StereoPipeline(CAMERA, settings, parallel=True)
    began = [thread for thread in threading.enumerate() if thread.ident not in before]
    assert began
    try:
        for i in range(4):
            step = made.process(*render(np.linalg.matrix_power(ASIDE, i), seed=i), i * 100_000_000)
            assert step.success
    finally:
        made.close()
    assert not any(thread.is_alive() for thread in began)


def test_without_threads_of_its_own_bundle_adjustment_depends_on_no_timing():
    settings = StereoSettings()
    odometry = replace(settings.odometry, keyframe_distance=0.05)
    settings = replace(settings, odometry=odometry, bundle=replace(settings.bundle, enabled=True))
    before = threading.active_count()
    runs = []
    for made in (StereoPipeline(CAMERA, settings), StereoPipeline(CAMERA, settings)):
        assert threading.active_count() == before
        images = [render(np.linalg.matrix_power(ASIDE, i), seed=i) for i in range(4)]
        runs.append([made.process(*pair, i * 100_000_000).T_keyframe_live for i, pair in enumerate(images)])
    for a, b in zip(*runs, strict=True):
        assert np.array_equal(a.T, b.T)
