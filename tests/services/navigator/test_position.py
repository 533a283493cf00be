"""The file that keeps where the robot stands."""

import threading
from types import SimpleNamespace

import pytest

from common.ids import VertexId
from services.navigator import position
from services.navigator.kept import Kept
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


def test_a_busy_disk_holds_up_nobody_but_the_thread_that_writes(tmp_path, monkeypatch):
    begun, free, stop = threading.Event(), threading.Event(), threading.Event()
    save_now = position.save

    def save_late(path, known):
        begun.set()
        assert free.wait(20.0)
        save_now(path, known)

    monkeypatch.setattr(position, "save", save_late)
    kept = Kept(tmp_path)
    places = [VertexId("20261122T204500123456-r1-9f3c1a", k) for k in range(3)]
    kept.keep_position(SimpleNamespace(environment="park", position=places[0]))
    writer = threading.Thread(target=lambda: kept.run(stop))
    writer.start()
    assert begun.wait(20.0)
    for place in places[1:]:
        kept.keep_position(SimpleNamespace(environment="park", position=place))
    free.set()
    stop.set()
    writer.join()
    assert load(tmp_path / "position.json") == Position("park", places[2])
