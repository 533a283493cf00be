"""Bearing-only pipeline and localizer on drives through a drawn forest."""

import numpy as np
import pytest

from common.geometry import Uncertain, yaw_of
from common.ids import VertexId
from common.messages import CameraFrame
from services.estimator.bearing import BearingSettings
from services.estimator.bearing.actions import ActionLog, along
from tests.services.estimator.bearing.forest import (
    FRAME_NS,
    MAP,
    Forest,
    curve,
    localizer,
    pipeline,
    steps,
    teach,
)

FOREST = Forest()
POSES = curve(16.0)


@pytest.fixture(scope="module")
def lesson():
    return teach(FOREST, POSES)


def beside(poses, left, turn=0.0):
    """Poses to the left of others, turned by an angle."""
    normal = np.stack([-np.sin(poses[:, 2]), np.cos(poses[:, 2])], axis=1)
    return np.column_stack([poses[:, :2] + left * normal, poses[:, 2] + turn])


def images(poses, **looks):
    return [FOREST.image(*pose, **looks) for pose in poses]


def drive(lesson, poses, pictures, **options):
    """The localizer after a drive, and what it made of each frame."""
    through = pipeline()
    found, results = localizer(*lesson, through, **options), []
    for step in steps(through, pictures, poses):
        found.move(step)
        results.append(found.follow(step) if found.chain.localized else found.search(step))
    return found, results


def heading_offset(found, path):
    """Heading of the robot less the taught one, by the chain."""
    T = found.chain.T_trunk_leaf().T
    ahead = min(found.chain.trunk + 1, len(path) - 1)
    step = np.linalg.inv(path[found.chain.trunk]) @ path[ahead]
    share = T[0, 3] / max(np.linalg.norm(step[:3, 3]), 1e-9)
    return float(yaw_of(T) - share * yaw_of(step))


def distance(found, path):
    """Metres along the map, by the chain."""
    along_path = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path[:, :3, 3], axis=0), axis=1))])
    return float(along_path[found.chain.trunk] + found.chain.T_trunk_leaf().T[0, 3])


def test_images_are_kept_by_distance_with_the_actions_between(lesson):
    vertices, path = lesson
    gaps = np.linalg.norm(np.diff(path[:, :3, 3], axis=0), axis=1)
    assert ((gaps > 0.39) & (gaps < 0.51)).all()
    actions = pipeline().read(vertices[5]).first.actions
    np.testing.assert_allclose(actions[:, 0], [0.1, 0.2, 0.3, 0.4, 0.5], atol=1e-3)
    np.testing.assert_allclose(actions[:, 1], [0.1, 0.2, 0.3, 0.4, 0.5], atol=1e-3)
    np.testing.assert_allclose(actions[:, 2:], [[1.0, 0.0]] * 5)


def test_a_keyframe_is_small_and_made_for_people_too(lesson):
    keyframe = lesson[0][3].keyframe
    assert keyframe.pipeline == "bearing"
    assert sum(array.nbytes for array in keyframe.arrays.values()) < 60_000
    assert keyframe.thumbnail.startswith(b"\xff\xd8")


def test_it_follows_the_taught_drive(lesson):
    found, results = drive(lesson, POSES, images(POSES))
    assert np.mean([result.success for result in results[2:]]) > 0.95
    assert distance(found, lesson[1]) == pytest.approx(16.0, abs=0.3)
    assert heading_offset(found, lesson[1]) == pytest.approx(0.0, abs=0.05)


@pytest.mark.parametrize("turn", [0.15, -0.15])
def test_a_robot_that_looks_further_left_has_a_positive_heading(lesson, turn):
    poses = beside(POSES[:60], 0.0, turn)
    found, _ = drive(lesson, poses, images(poses))
    assert heading_offset(found, lesson[1]) == pytest.approx(turn, abs=0.05)


@pytest.mark.parametrize("left", [0.5, -0.5])
def test_a_robot_beside_the_path_is_told_to_turn_towards_it(lesson, left):
    poses = beside(POSES[:80], left)
    found, _ = drive(lesson, poses, images(poses))
    assert 0.01 < np.sign(left) * heading_offset(found, lesson[1]) < 0.3


@pytest.mark.parametrize("first", [0, 12, 24])
def test_it_starts_within_a_few_metres_of_the_map_s_start(lesson, first):
    poses = POSES[first : first + 60]
    found, _ = drive(lesson, poses, images(poses))
    assert distance(found, lesson[1]) == pytest.approx(0.1 * (first + 59), abs=0.4)


def test_another_light_and_another_size_of_the_images_change_little(lesson):
    pictures = images(POSES[:70], width=320, height=192, light=0.5)
    found, _ = drive(lesson, POSES[:70], pictures)
    assert distance(found, lesson[1]) == pytest.approx(6.9, abs=0.4)
    assert heading_offset(found, lesson[1]) == pytest.approx(0.0, abs=0.04)


def test_images_of_another_shape_are_refused_with_a_sentence_and_dead_reckoning_goes_on(lesson):
    pictures = images(POSES[:40]) + images(POSES[40:60], width=96, height=96)
    found, results = drive(lesson, POSES[:60], pictures)
    assert not any(result.success for result in results[40:])
    assert "differ in shape" in results[-1].reason
    assert distance(found, lesson[1]) == pytest.approx(5.9, abs=0.5)
    assert found.chain.metres_since_success == pytest.approx(2.0, abs=0.05)


def test_what_is_not_like_the_map_counts_for_nothing(lesson):
    rng = np.random.default_rng(0)
    noise = [rng.integers(0, 255, (96, 160)).astype(np.uint8) for _ in range(20)]
    black = [np.zeros((96, 160), np.uint8)] * 20
    for pictures in (noise, black):
        _, results = drive(lesson, POSES[:20], pictures)
        assert not any(result.success for result in results)
        assert results[-1].reason


def test_without_wheels_there_is_a_sentence_and_no_vertex():
    through = pipeline()
    for k in range(3):
        step = through.take(CameraFrame(stamp=k, image=FOREST.image(*POSES[k])), None)
        assert not step.success
        assert "wheel odometry" in step.reason


def test_wheels_that_fall_silent_on_the_way_end_localization_with_a_sentence_until_they_are_back(lesson):
    through = pipeline()
    found, pictures = localizer(*lesson, through), images(POSES[:60])
    for step in steps(through, pictures[:30], POSES[:30]):
        found.move(step)
        found.follow(step) if found.chain.localized else found.search(step)
    for k in range(30, 34):
        step = through.take(CameraFrame(stamp=k * FRAME_NS, image=pictures[k]), None)
        found.move(step)
        result = found.follow(step)
        assert not result.success
        assert "wheel odometry" in result.reason
    for step in steps(through, pictures[33:], POSES[33:60], first=34):
        found.move(step)
        result = found.follow(step)
    assert result.success
    assert distance(found, lesson[1]) == pytest.approx(5.9, abs=0.4)


def test_submaps_that_are_not_here_yet_are_waited_for(lesson):
    _, results = drive(lesson, POSES[:3], images(POSES[:3]), missing=range(40))
    assert "not here yet" in results[-1].reason


def test_a_robot_that_stands_is_found_in_one_image_and_stays(lesson):
    poses = np.repeat(POSES[10:11], 20, axis=0)
    found, results = drive(lesson, poses, images(poses))
    assert results[-1].success
    assert distance(found, lesson[1]) == pytest.approx(1.0, abs=0.5)


def test_the_actions_told_are_those_around_the_robot(lesson):
    found, _ = drive(lesson, POSES[:60], images(POSES[:60]))
    actions = found.actions()
    assert actions[0, 0] >= -0.5
    assert 1.7 < actions[-1, 0] <= 2.0
    assert (np.diff(actions[:, 0]) >= 0.0).all()
    np.testing.assert_allclose(actions[:, 1:], [[1.0, 0.0]] * len(actions))


def test_one_vertex_alone_tells_the_heading(lesson):
    through = pipeline()
    submap = through.join([(through.read(vertex), Uncertain.identity()) for vertex in lesson[0][2:3]])
    (step,) = steps(through, images(beside(POSES[10:11], 0.0, 0.1)), POSES[10:11])
    found = through.localize(submap, Uncertain.identity(), step.live)
    assert found.success
    assert float(yaw_of(found.T_vertex_live.T)) == pytest.approx(0.1, abs=0.03)


def test_a_keyframe_of_another_kind_is_refused(lesson):
    vertex = lesson[0][0]
    stereo = vertex.model_copy(update={"keyframe": vertex.keyframe.model_copy(update={"pipeline": "stereo"})})
    bare = vertex.model_copy(update={"keyframe": vertex.keyframe.model_copy(update={"arrays": {}})})
    for record, why in ((stereo, "stereo"), (bare, "actions")):
        with pytest.raises(ValueError, match=why):
            pipeline().read(record)
    with pytest.raises(ValueError, match="represented by"):
        pipeline(BearingSettings(width=128)).read(vertex)


def test_an_image_too_small_is_refused():
    with pytest.raises(ValueError, match="too small"):
        pipeline(BearingSettings(skip_top=0.5)).take(CameraFrame(stamp=0, image=np.zeros((17, 64), np.uint8)), None)


def test_actions_are_laid_along_the_route_as_its_vertices_are():
    log = ActionLog()
    for k in range(4):
        log.move(0.1, 0.1)
        log.add(1.0, 0.1 * k, 0.02, 0.02)
    rows = log.take()
    assert len(log.take()) == 0
    laid = along([None, rows, None, rows], np.array([0.0, 0.42, 0.8, 1.22]))
    np.testing.assert_allclose(laid[:4, 0], [0.12, 0.22, 0.32, 0.42], atol=1e-6)
    np.testing.assert_allclose(laid[4:, 0], [0.92, 1.02, 1.12, 1.22], atol=1e-6)
    np.testing.assert_allclose(laid[:4, 2], [0.0, 0.1, 0.2, 0.3], atol=1e-6)


def test_the_trunk_is_a_vertex_of_the_route(lesson):
    found, _ = drive(lesson, POSES[:40], images(POSES[:40]))
    assert found.trunk == VertexId(MAP, found.chain.trunk)
    assert not found.metric
