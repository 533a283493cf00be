"""What a repeat tells of the maps that it followed."""

from __future__ import annotations

import numpy as np
import pytest

from common import geometry
from common.ids import VertexId
from common.messages import Localization, MapEnds, MapRecord, MapSummary, Route
from services.navigator.ends import Recording, place_of
from services.navigator.feedback import Feedback

A, B = "20261122T204500000001-r1-00000a", "20261122T204500000002-r2-00000b"
PERIOD_NS = 100_000_000


def route(name, maps, metres=10):
    """A straight route of a vertex a metre over maps."""
    vertices = [VertexId(map_id, index) for map_id in maps for index in range(metres)]
    path = np.stack([geometry.from_xy_yaw(float(k), 0, 0) for k in range(len(vertices))])
    return Route(
        id=name, environment="yard", goal="end", vertices=vertices, path=path, length=len(vertices) - 1.0, maps=maps,
        reason="",
    )  # fmt: skip


def drive(feedback, along, metres, *, lost=(), stamp=0, late=()):
    """Frames ten to a metre; those between the bounds of ``lost`` are on dead reckoning."""
    since = 0.0
    for k in range(round(metres * 10)):
        s = k / 10
        since = since + 0.1 if any(a <= s < b for a, b in lost) else 0.0
        stamp += PERIOD_NS * (3 if k in late else 1)
        index = min(round(s), len(along.vertices) - 1)
        feedback.take(
            Localization(
                stamp=stamp, route=along.id, trunk=along.vertices[index], trunk_index=index,
                T_trunk_robot=geometry.from_xy_yaw(s - index, 0, 0), covariance=np.eye(6), success=since == 0.0,
                stream="plain", inliers=9, metres_since_success=since, seconds_since_success=since,
            )
        )  # fmt: skip


@pytest.fixture
def feedback():
    return Feedback("report", "r1", "yard", 5, 0.1)


def test_a_good_repeat_has_no_trouble(feedback):
    one = route("x", [A])
    feedback.follow(one)
    drive(feedback, one, 9.0)
    report = feedback.report(arrived=True)
    (told,) = report.maps
    assert (told.map, told.lost, told.slow, told.finished, told.spans) == (A, 0.0, 0, True, [])
    assert told.metres == pytest.approx(8.9)
    assert told.frames == 90


def test_where_it_was_lost_is_told_by_map(feedback):
    one = route("x", [A, B])
    feedback.follow(one)
    drive(feedback, one, 18.0, lost=[(3.0, 7.0), (14.0, 14.5)], late={30, 31})
    first, second = feedback.report(arrived=False).maps
    assert first.lost == pytest.approx(4.0, abs=0.15)
    assert (first.spans[0].start, first.spans[0].end) == pytest.approx((3.0, 7.0), abs=0.2)
    assert first.slow == 2
    assert second.lost == 0.0, "half a metre on dead reckoning is no trouble"
    assert (first.finished, second.finished) == (True, False)


def test_a_route_that_goes_on_is_one_repeat(feedback):
    short, longer = route("x", [A]), route("y", [A, B])
    feedback.follow(short)
    drive(feedback, short, 9.0)
    feedback.follow(longer)
    drive(feedback, longer, 19.0)
    first, second = feedback.report(arrived=True).maps
    assert first.metres + second.metres == pytest.approx(18.9, abs=0.1)


def test_nothing_followed_is_nothing_told(feedback):
    assert feedback.report(arrived=False) is None


def summary(map_id, vertices=20, ends=("gate", "yard")):
    record = MapRecord(id=map_id, environment="yard", stamp=0, robot="r1", sensor="stereo")
    return MapSummary(
        record=record, vertices=vertices, length=9.0, bytes=1, finished=True, start_place=ends[0], end_place=ends[1]
    )


@pytest.mark.parametrize(("first", "last", "whole"), [(0, 19, True), (2, 17, True), (9, 19, False), (0, 9, False)])
def test_a_recording_has_the_ends_of_what_it_followed_if_it_followed_all(first, last, whole):
    record = MapRecord(id=B, environment="yard", stamp=0, robot="r1", sensor="stereo", generation=1, parent=A)
    recording = Recording(record)
    recording.follows(VertexId(B, 7))
    for index in (first, last):
        recording.follows(VertexId(A, index))
    places = ("gate", "yard") if whole else (None, None)
    assert recording.ends({A: summary(A)}) == MapEnds(map=B, start_place=places[0], end_place=places[1])
    assert recording.ends({}).start_place is None


def test_a_robot_at_an_end_of_a_map_is_at_its_place():
    maps = [summary(A)]
    assert place_of(VertexId(A, 0), maps) == "gate"
    assert place_of(VertexId(A, 19), maps) == "yard"
    assert place_of(VertexId(A, 9), maps) is None
    assert place_of(None, maps) is None
