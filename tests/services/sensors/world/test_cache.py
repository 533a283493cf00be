from pathlib import Path

import joblib
import numpy as np
import pytest

from services.sensors.world import cache
from services.sensors.world.cache import kept

calls: list[int] = []


def squares(count, offset=0):
    calls.append(count)
    return np.arange(count) ** 2 + offset


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    calls.clear()
    memory = joblib.Memory(tmp_path / "cache", verbose=0)
    monkeypatch.setattr(cache, "_memory", lambda: memory)
    return tmp_path / "cache"


def test_what_was_computed_once_is_not_computed_again():
    for _ in range(2):
        assert np.array_equal(kept(squares, 5), np.arange(5) ** 2)
    assert calls == [5]
    kept(squares, 6)
    assert calls == [5, 6]


def test_other_code_computes_anew(monkeypatch):
    kept(squares, 5)
    monkeypatch.setattr(cache, "_code", lambda: "of another day")
    kept(squares, 5)
    assert calls == [5, 5]


def test_what_stands_beside_the_arguments_is_no_key():
    kept(squares, 5, beside=(1,))
    assert np.array_equal(kept(squares, 5, beside=(2,)), np.arange(5) ** 2 + 1)
    assert calls == [5]


@pytest.mark.filterwarnings("ignore:.*:UserWarning")
def test_a_damaged_file_costs_a_computation(folder):
    kept(squares, 5)
    for file in folder.rglob("*.pkl"):
        file.write_bytes(file.read_bytes()[:20])
    assert np.array_equal(kept(squares, 5), np.arange(5) ** 2)
    assert calls == [5, 5]


def test_a_folder_that_cannot_be_written_costs_a_computation(monkeypatch):
    def refused():
        raise PermissionError(13, "Permission denied", str(Path("/nowhere")))

    monkeypatch.setattr(cache, "_memory", refused)
    assert np.array_equal(kept(squares, 5), np.arange(5) ** 2)
