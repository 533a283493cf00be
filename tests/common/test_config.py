from __future__ import annotations

import dataclasses
import os

import pytest

from common import config
from common.errors import ConfigurationError


@dataclasses.dataclass(frozen=True, slots=True)
class Limits:
    speed: float = 1.0
    turn_rate: float = 0.8


@dataclasses.dataclass(frozen=True, slots=True)
class Settings:
    limits: Limits = dataclasses.field(default_factory=Limits)
    rate_hz: float = 20.0
    horizon: int = 20
    names: tuple[str, ...] = ("front",)


ROBOT = '[robot]\nname = "r1"\n'


@pytest.fixture
def load(tmp_path):
    def loaded(text, table="tracker", kind=Settings):
        path = tmp_path / "robot.toml"
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        configuration = config.load(path)
        return configuration, configuration.settings(table, kind)

    return loaded


def test_defaults_stand_where_the_file_says_nothing(load):
    configuration, settings = load(ROBOT)
    assert settings == Settings()
    assert configuration.bus.endpoint == "tcp/127.0.0.1:7447"
    assert configuration.directory.name == "r1"


def test_a_table_is_read_into_its_dataclass(load):
    _, settings = load(ROBOT + '[tracker]\nhorizon = 12\nnames = ["a", "b"]\n[tracker.limits]\nspeed = 2\n')
    assert settings == Settings(Limits(speed=2.0), horizon=12, names=("a", "b"))
    assert isinstance(settings.limits, Limits)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (ROBOT + "[tracker]\nhorizn = 3\n", ["'tracker.horizn'", "did you mean 'horizon'"]),
        (ROBOT + "[tracker.limits]\nsped = 3\n", ["'tracker.limits.sped'", "did you mean 'speed'"]),
        (ROBOT + "[tracker]\nlimits = 3\n", ["'tracker.limits'"]),
        (ROBOT + "[tracker]\nrate_hz = 'fast'\n", ["'tracker.rate_hz'", "'fast'"]),
        (ROBOT + "[tracker]\nrate_hz = nan\n", ["'tracker.rate_hz'", "finite"]),
        (ROBOT + "[tracker.limits]\nspeed = inf\n", ["'tracker.limits.speed'", "finite"]),
        (ROBOT + "[tracker]\nhorizon = 2.5\n", ["'tracker.horizon'", "2.5"]),
        (ROBOT + "nmae = 3\n", ["'robot.nmae'", "did you mean 'name'"]),
        (ROBOT + "[bus]\nshared = true\n", ["'bus.shared'", "did you mean 'shared_memory'"]),
        ("[robot]\n", ["'robot.name' is missing"]),
        ("", ["'robot' is missing"]),
        ('[robot]\nname = "R 1"\n', ["'robot.name'", "'R 1'"]),
        (ROBOT + 'log_level = "loud"\n', ["'robot.log_level'", "'loud'"]),
        (ROBOT + '[bus]\nendpoint = "udp/x"\n', ["'bus.endpoint'", "'udp/x'"]),
        ("speed = 3\n" + ROBOT, ["'speed' stands outside of any table"]),
        (ROBOT + "[tracker\n", ["is not TOML", "line 3"]),
        (ROBOT + "a = 1\na = 2\n", ["is not TOML"]),
        (b"\xff\xfe", ["is not TOML"]),
        ("robot = 3\n", ["'robot'"]),
        ("tracker = 3\n" + ROBOT, ["'tracker' stands outside of any table"]),
    ],
)
def test_what_is_wrong_is_said_in_one_sentence(load, text, words):
    with pytest.raises(ConfigurationError) as caught:
        load(text)
    sentence = str(caught.value)
    assert "\n" not in sentence
    assert "robot.toml" in sentence
    for word in words:
        assert word in sentence


def test_no_file_a_folder_and_an_unreadable_file_are_said_in_one_sentence(tmp_path):
    for path in (tmp_path / "none.toml", tmp_path):
        with pytest.raises(ConfigurationError, match="cannot read the configuration") as caught:
            config.load(path)
        assert "\n" not in str(caught.value)
    if os.getuid():
        path = tmp_path / "locked.toml"
        path.write_text(ROBOT)
        path.chmod(0)
        with pytest.raises(ConfigurationError, match="Permission denied"):
            config.load(path)


def test_a_value_out_of_range_is_said_with_the_value(load):
    @dataclasses.dataclass(frozen=True, slots=True)
    class Ranged:
        speed: float = 1.0

        def __post_init__(self) -> None:
            if not 0 < self.speed <= 3:
                raise ValueError("a speed is above 0 and at most 3 m/s")

    with pytest.raises(ConfigurationError, match=r"'tracker': .*above 0 and at most 3 m/s"):
        load(ROBOT + "[tracker]\nspeed = 9\n", kind=Ranged)


def test_the_table_of_no_service_is_refused_with_the_nearest_one(load):
    configuration, _ = load(ROBOT + "[trackr]\nhorizon = 3\n")
    with pytest.raises(ConfigurationError, match=r"\[trackr\] is the table of no service; did you mean 'tracker'"):
        config.check_tables(configuration, {"tracker": Settings})
    configuration, _ = load(ROBOT + "[tracker]\nhorizon = 3\n")
    config.check_tables(configuration, {"tracker": Settings})
