"""The command line as a person meets it: help, exit codes, and one sentence for whatever is wrong."""

import json
import re
import socket
import subprocess
import sys

import pytest

from cli.app import command_line
from cli.commands import mission

GROUP = command_line()
NAMES = sorted(GROUP.commands)
OFFLINE = {("odometry",), ("localize",), ("replay-diff",), ("leave-one-out",), ("calibrate", "stereo")}
"""Commands whose --config is only where settings come from."""

ASKS_A_PERSON = {("drive",)}
MORE = {("position",): ["--find"], ("merge",): ["--confirm"], ("maps", "pull"): ["--all"], ("maps", "rm"): ["--yes"]}
"""What such a command needs beside its required arguments."""


def _has_config(command):
    return any("--config" in one.opts for one in command.params)


def _example(parameter):
    """A value that a required parameter takes."""
    value = "1.0" if parameter.name == "speed" else "some"
    return [value] if parameter.param_type_name == "argument" else [parameter.opts[0], value]


CLIENTS = (
    ("state",),
    ("teach",),
    ("teach", "--finish"),
    ("repeat", "dock"),
    ("position", "--find"),
    ("pause",),
    ("resume",),
    ("cancel",),
    ("estop",),
    ("estop", "--reset"),
    ("ps",),
    ("maps", "ls"),
    ("maps", "show", "20261122"),
    ("maps", "rm", "20261122"),
)


def _commands(command=GROUP, path=()):
    """Every command by its words."""
    nested = getattr(command, "commands", None)
    if nested is None:
        return {path: command}
    return {found: one for name in sorted(nested) for found, one in _commands(nested[name], (*path, name)).items()}


COMMANDS = _commands()
EVERY = pytest.mark.parametrize("path", list(COMMANDS), ids=" ".join)


@EVERY
def test_every_command_has_help_and_json(vtr, path):
    result = vtr(*path, "--help")
    assert result.code == 0
    assert "--json" in result.out


@EVERY
def test_every_command_is_described_in_one_sentence_that_begins_with_a_verb(path):
    described = " ".join(COMMANDS[path].help.split())
    assert re.fullmatch(r"[A-Z][a-z]+,? .*[^.][.]", described), described
    assert ". " not in described
    assert described.split()[0] not in {"The", "A", "An", "This", "It"}


@EVERY
def test_every_command_says_of_an_option_that_it_does_not_have_that_it_has_none(vtr, path):
    result = vtr(*path, "--nonsense")
    assert result.code == 2
    assert "--nonsense" in result.sentence
    assert result.out == ""


@EVERY
def test_every_option_has_a_help_text(path):
    assert [one.name for one in COMMANDS[path].params if not getattr(one, "help", None)] == []


@pytest.mark.parametrize(
    "path", [path for path, one in COMMANDS.items() if path not in OFFLINE and _has_config(one)], ids=" ".join
)
def test_every_command_of_a_robot_names_the_file_that_it_cannot_read(vtr, path, tmp_path):
    missing = tmp_path / "missing.toml"
    needed = [value for one in COMMANDS[path].params if one.required for value in _example(one)]
    result = vtr(*path, *needed, *MORE.get(path, ()), "--config", missing)
    assert result.code != 0
    assert ("missing.toml" if path not in ASKS_A_PERSON else "terminal") in (
        result.sentence if not result.out else result.out
    )


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        (("align", "nothing.png", "nowhere.png"), "nothing.png"),
        (("align", "--pairs", "nothing.csv"), "nothing.csv"),
        (("calibrate", "nothing"), "nothing"),
        (("calibrate", "--print-board", "board.png", "--board", "7by5"), "7by5"),
        (("chaos", "--runs", "0"), "--runs"),
        (("chaos", "--only", "earthquake"), "earthquake"),
        (("soak", "--minutes", "0"), "--minutes"),
        (("demo", "--robots", "9"), "--robots"),
        (("demo", "--teach-time", "25:00"), "25:00"),
        (("leave-one-out", "--first", "noon"), "noon"),
        (("odometry", "nothing"), "nothing"),
        (("localize", "nothing"), "nothing"),
        (("play", "nothing", "--info"), "nothing"),
        (("replay-diff", "nothing"), "nothing"),
        (("env", "cost", "--env", "nothing.json"), "nothing.json"),
        (("env", "spectrum", "--series", "nothing.csv"), "nothing.csv"),
        (("env", "similarity", "nothing"), "nothing"),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, tuple) else "",
)
def test_offline_commands_name_what_they_cannot_use(vtr, arguments, word):
    for more in ((), ("--json",)):
        result = vtr(*arguments, *more)
        assert result.code in (1, 2)
        assert word in result.sentence
        assert result.out == ""


def test_flags_show_no_type_in_the_help(vtr):
    assert "<bool>" not in vtr("repeat", "--help").out + vtr("--help").out


def test_the_version_is_that_of_the_distribution(vtr):
    assert vtr("--version").out.startswith("vtr 0")


def test_vtr_alone_lists_the_commands(vtr):
    result = vtr()
    assert result.code == 0
    assert all(name in result.out for name in NAMES)


def test_the_help_loads_nothing_heavy():
    script = "import sys, cli.__main__; print([m for m in ('numpy', 'zenoh', 'numba', 'cv2') if m in sys.modules])"
    out = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True).stdout
    assert out.strip() == "[]"


@pytest.mark.parametrize(
    ("arguments", "word"), [(("fly",), "fly"), (("repeat",), "goal"), (("up", "--fast"), "--fast")]
)
def test_what_is_no_command_ends_with_one_sentence(vtr, arguments, word):
    result = vtr(*arguments)
    assert result.code == 2
    assert word in result.sentence.lower()


@pytest.mark.parametrize("command", CLIENTS, ids=" ".join)
def test_without_a_router_every_client_says_so(vtr, write_config, command):
    result = vtr(*command, "--config", write_config())
    assert result.code == 1
    assert result.sentence.startswith("no router answers at tcp/127.0.0.1:")
    assert "vtr up" in result.sentence
    assert result.out == ""


def test_a_port_that_is_no_router_is_no_router(vtr, write_config):
    with socket.create_server(("127.0.0.1", 0)) as other:
        config = write_config(endpoint=f"tcp/127.0.0.1:{other.getsockname()[1]}")
        assert vtr("pause", "--config", config).sentence.startswith("no router answers")


def test_without_a_robot_the_command_asks_for_one(vtr):
    result = vtr("pause")
    assert result.code == 1
    assert "--config" in result.sentence


def test_robot_toml_of_the_present_folder_is_used(vtr, write_config):
    write_config()
    assert "no router answers" in vtr("pause").sentence


@pytest.mark.parametrize(
    ("tables", "words"),
    [
        ("[tracker]\nperiodd_s = 0.1\n", ("tracker.periodd_s", "'period_s'")),
        ("[trakcer]\n", ("[trakcer]", "'tracker'")),
        ('[sensors]\ndriver = "lidar"\n', ("sensors.driver", "lidar")),
        ("[sensors]\nframe_rate = 0.0\n", ("frame_rate", "positive")),
        ('[sensors]\nsimulate = ["radar"]\n', ("sensors.simulate", "radar")),
        ("[sensors]\nsimulate = []\n", ("simulate", "driver 'none'")),
        ("[sensors.world.lidar]\nbeams = 1\n", ("beams", "2 to 256")),
        ("[sensors.world.lidar]\nbeam = 16\n", ("sensors.world.lidar.beam", "'beams'")),
        ("[sensors\n", ("TOML",)),
    ],
)
def test_a_wrong_configuration_starts_nothing(vtr, write_config, tmp_path, tables, words):
    result = vtr("up", write_config(tables))
    assert result.code == 1
    assert all(word in result.sentence for word in words)
    assert not (tmp_path / "data").exists()


def test_a_port_in_use_starts_nothing(vtr, write_config, tmp_path):
    with socket.create_server(("127.0.0.1", 0)) as other:
        endpoint = f"tcp/127.0.0.1:{other.getsockname()[1]}"
        result = vtr("up", write_config(endpoint=endpoint), "--detach")
    assert result.code == 1
    assert endpoint in result.sentence
    assert "in use" in result.sentence
    assert not (tmp_path / "data").exists()


def test_a_directory_that_cannot_be_made_starts_nothing(vtr, write_config, tmp_path):
    (tmp_path / "data").write_text("a file stands in the way")
    result = vtr("up", write_config(), "--detach")
    assert result.code == 1
    assert "cannot write to" in result.sentence


def test_a_demo_needs_a_folder_that_it_can_write_to(vtr, tmp_path):
    (tmp_path / "file").write_text("")
    result = vtr("demo", "--out", tmp_path / "file" / "demo")
    assert result.code == 1
    assert "cannot write to" in result.sentence


def test_a_demo_leaves_what_is_not_its_own(vtr, write_config, tmp_path):
    before = write_config().read_text()
    kept = tmp_path / "data" / "kept"
    kept.parent.mkdir()
    kept.write_text("recorded")
    result = vtr("demo", "--out", tmp_path)
    assert result.code == 1
    assert "is not of a demo" in result.sentence
    assert kept.read_text() == "recorded"
    assert (tmp_path / "robot.toml").read_text() == before


def test_a_pipeline_that_is_not_there_is_named_with_those_that_are(vtr, tmp_path):
    result = vtr("odometry", tmp_path, "--pipeline", "sonar")
    assert result.code == 2
    assert result.sentence == "Invalid value for '--pipeline': 'sonar' is not one of 'stereo', 'lidar'."


@pytest.mark.parametrize("option", [(), ("--config",)], ids=["argument", "option"])
def test_down_needs_a_running_robot(vtr, write_config, option):
    result = vtr("down", *option, write_config())
    assert result.code == 1
    assert "not running" in result.sentence


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        (("teach", "--start-place", "The Dock"), "The Dock"),
        (("teach", "--end-place", "dock"), "--finish"),
        (("teach", "--finish", "--from", "x:1"), "--finish"),
        (("repeat", "dock", "--from", "nowhere"), "map:index"),
        (("play", "missing", "--start-place", "dock"), "--as teach"),
        (("play", "missing"), "missing"),
    ],
)
def test_a_wrong_argument_is_named_before_anything_is_asked(vtr, write_config, arguments, word):
    result = vtr(*arguments, "--config", write_config())
    assert result.code == 1
    assert word in result.sentence


def test_an_unexpected_error_is_a_sentence_and_its_traceback_is_kept(vtr, monkeypatch, tmp_path):
    def broken(*_arguments, **_options):
        raise KeyError("secret")

    monkeypatch.setattr("cli.operator.carry_out", broken)
    result = vtr("pause")
    assert result.code == 3
    log = tmp_path / "home" / ".local" / "state" / "retraverse" / "vtr.log"
    assert "KeyError" in result.sentence
    assert str(log) in result.sentence
    assert mission.__file__ in log.read_text()
    assert "Traceback" in vtr("--debug", "pause").err


def test_doctor_fails_on_a_wrong_configuration_and_says_which_check(vtr, write_config):
    result = vtr("doctor", "--config", write_config("[sensor]\n"), "--json")
    report = json.loads(result.out)
    verdicts = {check["name"]: check["verdict"] for check in report["checks"]}
    assert result.code == 1
    assert report["ok"] is False
    assert verdicts["configuration"] == "fail"
    assert "configuration" in result.sentence


def test_doctor_finds_the_pages_port_in_use(vtr, write_config):
    with socket.create_server(("127.0.0.1", 0)) as other:
        tables = f"[console]\nport = {other.getsockname()[1]}\n"
        result = vtr("doctor", "--config", write_config(tables), "--json")
    (page,) = (check for check in json.loads(result.out)["checks"] if check["name"] == "page")
    assert (page["verdict"], "another program" in page["text"]) == ("fail", True)


def test_doctor_finds_a_port_that_somebody_else_uses(vtr, write_config):
    with socket.create_server(("127.0.0.1", 0)) as other:
        result = vtr("doctor", "--config", write_config(endpoint=f"tcp/127.0.0.1:{other.getsockname()[1]}"), "--json")
    checks = {check["name"]: check for check in json.loads(result.out)["checks"]}
    assert checks["router"]["verdict"] == "fail"
    assert checks["python"]["verdict"] == checks["dependencies"]["verdict"] == "ok"
    assert result.code == 1
