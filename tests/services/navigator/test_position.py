"""The file that keeps where the robot stands."""

import pytest

from common.ids import VertexId
from services.navigator.position import Position, PositionUnreadable, load, save


def test_a_position_survives(tmp_path):
    path = tmp_path / "run" / "position.json"
    position = Position("park", VertexId("20261122T204500123456-r1-9f3c1a", 12))
    save(path, position)
    assert load(path) == position
    save(path, None)
    assert load(path) is None


@pytest.mark.parametrize(
    "content", [b"", b"{", b"[]", b"null", b'{"environment": "park"}', b'{"environment": 1, "vertex": "x"}', b"\xff"]
)
def test_a_broken_file_is_told(tmp_path, content):
    path = tmp_path / "position.json"
    path.write_bytes(content)
    with pytest.raises(PositionUnreadable, match="position"):
        load(path)
