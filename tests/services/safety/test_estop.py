import os

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from services.safety.estop import EmergencyStop, LatchStoreError


def test_a_new_robot_is_not_stopped(tmp_path):
    assert EmergencyStop(tmp_path / "estop.json").reason is None


def test_the_latch_and_its_reason_survive_a_restart_until_the_reset(tmp_path):
    file = tmp_path / "state" / "estop.json"
    stop = EmergencyStop(file)
    stop.engage("The operator pressed the button.")
    stop.engage("And again.")
    assert EmergencyStop(file).reason == "The operator pressed the button."
    stop.reset()
    assert stop.reason is None
    assert EmergencyStop(file).reason is None


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(content=st.one_of(st.binary(), st.sampled_from([b"null", b"{}", b'{"latched": 0}', b'{"latched": true}'])))
def test_a_damaged_file_means_stopped(tmp_path, content):
    file = tmp_path / "estop.json"
    file.write_bytes(content)
    assert EmergencyStop(file).reason is not None


def test_a_file_cut_short_anywhere_means_stopped(tmp_path):
    file = tmp_path / "estop.json"
    stop = EmergencyStop(file)
    stop.engage("A reason.")
    stop.reset()
    whole = file.read_bytes()
    for length in range(len(whole)):
        file.write_bytes(whole[:length])
        assert EmergencyStop(file).reason is not None


def test_a_file_that_cannot_be_read_means_stopped(tmp_path):
    (tmp_path / "estop.json").mkdir()
    assert EmergencyStop(tmp_path / "estop.json").reason is not None


def test_stops_even_where_it_cannot_be_written_and_then_stays_stopped(tmp_path):
    (tmp_path / "blocked").write_text("a file, not a folder")
    stop = EmergencyStop(tmp_path / "blocked" / "estop.json")
    with pytest.raises(LatchStoreError):
        stop.engage("A reason.")
    assert stop.reason is not None
    with pytest.raises(LatchStoreError):
        stop.reset()
    assert stop.reason is not None


def test_a_latch_holds_before_it_is_on_disk_and_beyond_once_it_is(tmp_path):
    stop = EmergencyStop(tmp_path / "estop.json")
    stop.latch("The button.")
    assert stop.reason == "The button."
    stop.save()
    assert EmergencyStop(tmp_path / "estop.json").reason == "The button."


def test_a_press_during_a_reset_is_not_lost(tmp_path, monkeypatch):
    file = tmp_path / "estop.json"
    stop = EmergencyStop(file)
    stop.engage("The first.")
    presses = iter(["The second."])
    flush = os.fsync

    def press_meanwhile(descriptor):
        for reason in presses:
            stop.latch(reason)
        flush(descriptor)

    monkeypatch.setattr("services.safety.estop.os.fsync", press_meanwhile)
    assert not stop.reset()
    assert stop.reason is not None
    assert EmergencyStop(file).reason is not None
    assert stop.reset()
    assert stop.reason is None


def test_leaves_nothing_else_behind(tmp_path):
    stop = EmergencyStop(tmp_path / "estop.json")
    stop.engage("A reason.")
    stop.reset()
    assert [entry.name for entry in tmp_path.iterdir()] == ["estop.json"]
