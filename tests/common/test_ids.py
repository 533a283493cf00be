from __future__ import annotations

import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.ids import MAP_ID_PATTERN, NAME_PATTERN, VertexId, new_map_id


@given(st.integers(0, 4_000_000_000_000_000_000), st.from_regex(NAME_PATTERN, fullmatch=True))
def test_a_new_map_id_has_the_form_of_one(stamp, robot):
    assert re.fullmatch(MAP_ID_PATTERN, new_map_id(robot, stamp))


@given(st.lists(st.integers(0, 4_000_000_000_000_000), min_size=2, max_size=8, unique=True))
def test_map_ids_sort_by_time(microseconds):
    stamps = [us * 1000 for us in sorted(microseconds)]
    ids = [new_map_id("r1", stamp) for stamp in stamps]
    assert ids == sorted(ids)


def test_two_maps_of_one_moment_differ():
    assert len({new_map_id("r1", 0) for _ in range(20)}) == 20


@given(st.from_regex(MAP_ID_PATTERN, fullmatch=True), st.integers(0, 999_999_999))
def test_a_vertex_is_read_as_it_is_written(map_id, index):
    vertex = VertexId(map_id.strip(), index)
    assert VertexId.parse(str(vertex)) == vertex


@pytest.mark.parametrize("text", ["", "map", "map:", ":3", "map:-1", "map:3\n", "map:3:4", "map:٣", "map:9999999999"])
def test_what_is_no_vertex_is_refused_with_its_form(text):
    with pytest.raises(ValueError, match="map:index"):
        VertexId.parse(text)
