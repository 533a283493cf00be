"""The command line as a person meets it: help, exit codes, and one sentence for whatever is wrong."""

import json
import socket
import subprocess
import sys

import pytest
import typer

from cli.app import app
from cli.commands import mission

GROUP = typer.main.get_command(app)
NAMES = sorted(GROUP.commands)
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


def _paths():
    for name in NAMES:
        nested = getattr(GROUP.commands[name], "commands", None)
        yield from [(name, inner) for inner in sorted(nested)] if nested else [(name,)]


@pytest.mark.parametrize("path", list(_paths()), ids=" ".join)
def test_every_command_has_help_and_json(vtr, path):
    result = vtr(*path, "--help")
    assert result.code == 0
    assert "--json" in result.out


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


def test_down_needs_a_running_robot(vtr, write_config):
    result = vtr("down", write_config())
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


def test_doctor_finds_a_port_that_somebody_else_uses(vtr, write_config):
    with socket.create_server(("127.0.0.1", 0)) as other:
        result = vtr("doctor", "--config", write_config(endpoint=f"tcp/127.0.0.1:{other.getsockname()[1]}"), "--json")
    checks = {check["name"]: check for check in json.loads(result.out)["checks"]}
    assert checks["router"]["verdict"] == "fail"
    assert checks["python"]["verdict"] == checks["dependencies"]["verdict"] == "ok"
    assert result.code == 1
