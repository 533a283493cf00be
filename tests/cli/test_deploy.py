"""The example configurations say what the services know, and the defaults that they have."""

import re
from pathlib import Path

import pytest

from cli import robot
from common import config

DEPLOY = Path(__file__).resolve().parents[2] / "deploy"


EXAMPLES = sorted(str(path.relative_to(DEPLOY)) for path in DEPLOY.rglob("*.toml"))


@pytest.mark.parametrize("name", EXAMPLES)
def test_an_example_is_a_right_configuration(name):
    robot.check(robot.load(DEPLOY / name))


def written_out(name, folder):
    """An example with everything in it that is commented out, and as it is."""
    path = folder / name
    path.write_text(re.sub(r"^# (\w+ = )", r"\1", (DEPLOY / name).read_text(), flags=re.MULTILINE))
    full = config.load(path)
    robot.check(full)
    return full, config.load(DEPLOY / name)


def test_what_is_commented_out_stands_at_its_default(tmp_path):
    full, bare = written_out("robot.toml", tmp_path)
    assert (full.robot, full.bus) == (bare.robot, bare.bus)
    for table, kind in robot.settings_kinds().items():
        assert repr(full.settings(table, kind)) == repr(kind()), table


def test_a_ros_robots_file_has_the_defaults_of_the_driver(tmp_path):
    full, bare = written_out("ros2.toml", tmp_path)
    kind = robot.settings_kinds()["sensors"]
    assert repr(full.settings("sensors", kind)) == repr(bare.settings("sensors", kind))


def test_playback_leaves_the_sensors_topics_to_the_player():
    kinds = robot.settings_kinds()
    assert robot.load(DEPLOY / "playback.toml").settings("sensors", kinds["sensors"]).driver == "none"
