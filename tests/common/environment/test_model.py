"""An environment's file: read as written, and a sentence for each way in which it can be wrong."""

import json
from datetime import UTC, datetime, timedelta

import pytest

from common.environment import MapTable, read_environment
from common.errors import ConfigurationError
from tests.common.environment.thesis import DAILY, EXPERIMENT_2, environment


def written(folder, content):
    path = folder / "env.json"
    path.write_text(content if isinstance(content, str) else json.dumps(content), encoding="utf-8")
    return path


def test_a_file_is_read_into_columns_in_its_order(tmp_path):
    maps = MapTable.of(read_environment(written(tmp_path, environment(EXPERIMENT_2))).maps)
    assert list(maps.names) == [row[0] for row in EXPERIMENT_2]
    assert [(maps.places[a], maps.places[b]) for a, b in zip(maps.start, maps.end, strict=True)] == [
        (row[1], row[2]) for row in EXPERIMENT_2
    ]
    assert maps.length.tolist() == [row[4] for row in EXPERIMENT_2]
    assert (maps.generation == 0).all()


@pytest.mark.parametrize(
    ("text", "offset_hours"),
    [("2023-05-07T17:08:32", 0), ("2023-05-07 17:08:32Z", 0), ("2023-05-07T17:08:32+02:00", 2)],
)
def test_times_without_an_offset_are_utc(tmp_path, text, offset_hours):
    read = read_environment(written(tmp_path, environment([("m", "A", "B", text, 1.0)])))
    expected = datetime(2023, 5, 7, 17, 8, 32, tzinfo=UTC) - timedelta(hours=offset_hours)
    assert read.maps[0].timestamp == expected


def test_what_may_be_left_out(tmp_path):
    read = read_environment(written(tmp_path, {"name": "yard"}))
    assert read.maps == ()
    assert read.model.periods_hours == ()
    assert len(MapTable.of(read.maps)) == 0


def broken(**changes):
    """A file of one map in which some keys are replaced, or removed by None."""
    entry = {"name": "m", "start": "A", "end": "B", "timestamp": "2023-05-07T17:08:32", "length": 3.0} | changes
    return {"name": "e", "model": DAILY, "maps": [{k: v for k, v in entry.items() if v is not None}]}


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ("{", ["is not JSON"]),
        ("[" * 100_000, ["is not JSON"]),
        ("[]", ["the file must be a JSON object"]),
        ({"maps": []}, ["'name' is missing"]),
        (broken(timestamp="yesterday"), ["maps[0].timestamp", "'yesterday' is no time", "ISO 8601"]),
        (broken(timestamp=5), ["maps[0].timestamp", "ISO 8601"]),
        (broken(length=-1), ["maps[0].length"]),
        (broken(length="far"), ["maps[0].length", "far"]),
        (broken(length=float("nan")), ["maps[0].length"]),
        (broken(end=None), ["'maps[0].end' is missing"]),
        (broken(end=""), ["maps[0].end", "empty"]),
        (broken(generation=-2), ["maps[0].generation"]),
        (broken(lenght=2), ["'maps[0].lenght' is not known", "did you mean 'length'"]),
        ({"name": "e", "maps": broken()["maps"] * 2}, ["two maps are named 'm'"]),
        ({"name": "e", "model": DAILY | {"weights": []}}, ["1 periods, 0 weights and 1 phases"]),
        ({"name": "e", "model": DAILY | {"periods_hours": [0]}}, ["model.periods_hours[0]"]),
        ({"name": "e", "model": DAILY | {"trend_per_hour": -1}}, ["model.trend_per_hour"]),
        ({"name": "e", "model": DAILY | {"period_hours": [1]}}, ["did you mean 'periods_hours'"]),
        ({"name": "e", "model": None}, ["model must be a JSON object"]),
    ],
)
def test_what_is_wrong_is_said_in_one_sentence(tmp_path, content, words):
    with pytest.raises(ConfigurationError) as refusal:
        read_environment(written(tmp_path, content))
    assert "\n" not in str(refusal.value)
    assert all(word in str(refusal.value) for word in ["env.json", *words])


def test_a_file_that_cannot_be_read_is_named(tmp_path):
    with pytest.raises(ConfigurationError, match="nowhere"):
        read_environment(tmp_path / "nowhere.json")
    with pytest.raises(ConfigurationError, match="directory"):
        read_environment(tmp_path)
