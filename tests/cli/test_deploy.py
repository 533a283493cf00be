"""The example configurations say what the services know, and the defaults that they have."""

import re
from pathlib import Path

import pytest

from cli import robot
from common import config

DEPLOY = Path(__file__).resolve().parents[2] / "deploy"


@pytest.mark.parametrize("name", ["robot.toml", "playback.toml", "cameras.toml"])
def test_an_example_is_a_right_configuration(name):
    robot.check(robot.load(DEPLOY / name))


def test_what_is_commented_out_stands_at_its_default(tmp_path):
    text = (DEPLOY / "robot.toml").read_text()
    written_out = tmp_path / "robot.toml"
    written_out.write_text(re.sub(r"^# (\w+ = )", r"\1", text, flags=re.MULTILINE))
    full, bare = config.load(written_out), config.load(DEPLOY / "robot.toml")
    robot.check(full)
    assert (full.robot, full.bus) == (bare.robot, bare.bus)
    for table, kind in robot.settings_kinds().items():
        assert repr(full.settings(table, kind)) == repr(kind()), table


def test_playback_leaves_the_sensors_topics_to_the_player():
    kinds = robot.settings_kinds()
    assert robot.load(DEPLOY / "playback.toml").settings("sensors", kinds["sensors"]).driver == "none"
