"""The demo's times of day: what is one, when the sun is up, and what the world is told."""

from __future__ import annotations

import tomllib
from datetime import UTC, datetime

import pytest

from cli.daylight import Times, daylight_hours, times
from cli.demo.configuration import write_config
from cli.errors import CommandError
from common import config
from services.sensors.settings import Settings
from services.sensors.world import WorldSettings, sun_angles

WORLD = WorldSettings()
NINE, FIVE = datetime(2026, 6, 21, 9, 0, tzinfo=UTC), datetime(2026, 6, 21, 17, 0, tzinfo=UTC)


def test_times_are_moments_of_the_world_s_day():
    assert times("09:00", "17:00", WORLD) == Times(NINE, FIVE)
    assert times(None, "17:00", WORLD) == Times(WORLD.time, FIVE)
    assert times("9:00", None, WORLD) == Times(NINE, NINE)
    assert times(None, None, WORLD) == Times(WORLD.time, WORLD.time)


@pytest.mark.parametrize("text", ["9", "25:00", "12:60", "noon", "", "-1:00", "09:00:30"])
def test_what_is_no_time_of_day_is_refused(text):
    with pytest.raises(CommandError, match="HH:MM"):
        times(text, None, WORLD)


def test_the_night_is_refused_with_the_hours_of_the_day():
    rise, fall = daylight_hours(NINE, WORLD)
    with pytest.raises(CommandError, match=f"--repeat-time.*from {rise} to {fall}"):
        times("09:00", "23:30", WORLD)
    for text in (rise, fall):
        assert sun_angles(times(text, None, WORLD).teach, WORLD.latitude, WORLD.longitude)[1] == pytest.approx(
            0, abs=0.01
        )


def test_the_night_is_a_time_for_a_sensor_with_a_light_of_its_own():
    night = datetime(2026, 6, 21, 23, 30, tzinfo=UTC)
    assert times("23:30", None, WORLD, by_night=True) == Times(night, night)
    assert times(None, "23:30", WORLD, by_night=True) == Times(WORLD.time, night)
    with pytest.raises(CommandError, match="HH:MM"):
        times("24:30", None, WORLD, by_night=True)


def test_a_polar_night_has_no_hours():
    polar = WorldSettings(latitude=80.0, time=datetime(2026, 12, 21, 11, tzinfo=UTC))
    assert daylight_hours(polar.time, polar) == ("", "")
    with pytest.raises(CommandError, match="never rises"):
        times("11:00", None, polar)


def test_the_command_refuses_before_anything_is_made(vtr, tmp_path):
    result = vtr("demo", "--teach-time", "9am", "--out", tmp_path / "demo")
    assert result.code == 1
    assert "--teach-time" in result.sentence
    assert not (tmp_path / "demo").exists()


def test_the_world_begins_at_the_teach_and_a_changing_light_has_no_clouds(tmp_path):
    for light, clouds in ((Times(NINE, FIVE), 0.0), (Times(NINE, NINE), WORLD.clouds), (None, WORLD.clouds)):
        path = tmp_path / "robot.toml"
        write_config(path, tmp_path / "data", light)
        assert tomllib.loads(path.read_text())["robot"]["name"] == "demo"
        world = config.load(path).settings("sensors", Settings).world
        assert world.clouds == clouds
        assert world.time == (WORLD.time if light is None else NINE)
