"""The metadata of stored maps."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from common import geometry
from common.environment.metadata import Archive, MapMetadata
from common.messages import Commit, MapEnds
from services.mapstore.metadata import driven_actions, held, metadata_of
from tests.services.mapstore.graphs import drive, map_id

ARCHIVE = Archive(bytes=10, sha256="0" * 64)


def with_picture(commit, number):
    if commit.vertex is None:
        return commit
    noise = np.random.default_rng(number).integers(0, 256, (25, 40), dtype=np.uint8)
    picture = cv2.imencode(".jpg", cv2.resize(noise, (200, 125)))[1].tobytes()
    keyframe = commit.vertex.keyframe.model_copy(update={"thumbnail": picture})
    return commit.model_copy(update={"vertex": commit.vertex.model_copy(update={"keyframe": keyframe})})


def test_a_map_s_metadata_tells_all_that_the_thesis_lists(store):
    for number, commit in enumerate(drive(1, 6)):
        store.commit(with_picture(commit, number))
    store.ends(MapEnds(map=map_id(1), start_place="gate", end_place="yard"))
    found = metadata_of(store, map_id(1), ARCHIVE)
    assert found == MapMetadata.model_validate_json(found.model_dump_json())
    assert (found.name, found.robot, found.sensor, found.generation) == (map_id(1), "r1", "front", 0)
    assert (found.start, found.end, found.vertices) == ("gate", "yard", 6)
    assert found.distances == pytest.approx([0.0, 0.5, 1.0, 1.5, 2.0, 2.5])
    assert found.length == pytest.approx(2.5)
    assert [image.distance for image in found.images] == [0.0, 1.0, 1.5, 2.5]
    assert found.images[0].described().values.shape == (6, 10, 64)
    assert len(found.model_dump_json()) < 40_000


def test_pictures_that_are_none_are_left_out(store):
    for commit in drive(1, 3):
        store.commit(commit)
    store.ends(MapEnds(map=map_id(1)))
    assert metadata_of(store, map_id(1), ARCHIVE).images == []


def test_what_was_driven_tells_speed_and_turn():
    steps = np.stack([geometry.from_xy_yaw(1.0, 0.0, 0.2), geometry.from_xy_yaw(-0.5, 0.0, 0.0)])
    actions = driven_actions(np.array([0.0, 2.0, 3.0]), np.array([0.0, 1.0, 1.5]), steps)
    assert actions[0] == pytest.approx((0.0, 0.0, 0.5, 0.1))
    assert actions[1] == pytest.approx((2.0, 1.0, -0.5, 0.0))


def with_actions(commit):
    if commit.vertex is None or commit.vertex.id.index == 0:
        return commit
    rows = np.array([[0.1, 0.2, 1.0, 0.3 * commit.vertex.id.index]], dtype=np.float32)
    keyframe = commit.vertex.keyframe
    keyframe = keyframe.model_copy(update={"arrays": keyframe.arrays | {"actions": rows}})
    return Commit(vertex=commit.vertex.model_copy(update={"keyframe": keyframe}), edges=commit.edges)


def test_recorded_commands_are_counted_from_the_map_s_start(store):
    for commit in drive(1, 3):
        store.commit(with_actions(commit))
    actions = metadata_of(store, map_id(1), ARCHIVE).actions
    assert [row[1] for row in actions] == pytest.approx([0.1, 0.6])
    assert actions[0][2:] == pytest.approx((1.0, 0.3))


def test_a_command_holds_until_it_changes():
    rows = [(0.0, 0.0, 1.0, 0.0), (0.1, 0.1, 1.004, 0.0), (0.2, 0.2, 1.008, 0.0), (0.3, 0.3, 1.012, 0.0)]
    assert held([*rows, (0.4, 0.4, 1.012, 0.1)]) == [rows[0], rows[3], (0.4, 0.4, 1.012, 0.1)]
    assert held([]) == []
