"""``vtr`` in a terminal: the view that watches a robot, the keys that drive it, colours, and a shell's completion."""

import json
import os
import signal
import subprocess
import sys
import threading

import numpy as np
import pytest

from cli.keyboard import HELD_S, Keys
from common import topics
from common.ids import VertexId, new_map_id
from common.messages import (
    Goal,
    Localization,
    MapList,
    MapRecord,
    MapSummary,
    SafetyStatus,
    State,
    StateName,
    StopReason,
    TrackerStatus,
    now_ns,
)
from tests.processes import ROOT, Robot, eventually
from tests.terminal import Terminal

VERTEX = VertexId(new_map_id("r1", 0), 3)


@pytest.fixture(scope="module")
def robot(tmp_path_factory):
    with Robot(tmp_path_factory.mktemp("robot")) as robot, Speaking(robot):
        yield robot


class Speaking:
    """Navigator, safety, estimator and tracker of a robot that repeats, a bit lost; the store has one map."""

    def __init__(self, robot):
        self._stop = threading.Event()
        buses = [robot.act_as(name) for name in ("navigator", "safety", "estimator", "tracker")]
        kinds = (topics.STATE, topics.SAFETY_STATUS, topics.LOCALIZATION, topics.TRACKER_STATUS)
        self._publishers = [bus.publisher(topic) for bus, topic in zip(buses, kinds, strict=True)]
        record = MapRecord(id=VERTEX.map_id, environment="garden", stamp=0, robot="r1", sensor="stereo")
        summary = MapSummary(
            record=record, vertices=8, length=3.0, bytes=1, finished=True, start_place="shed", end_place="gate"
        )
        robot.act_as("mapstore").serve(topics.MAPS, lambda _: MapList(maps=[summary]))
        self._thread = threading.Thread(target=self._speak)

    def __enter__(self):
        self._thread.start()

    def __exit__(self, *_error):
        self._stop.set()
        self._thread.join()

    def _speak(self):
        while not self._stop.wait(0.1):
            for publisher, message in zip(self._publishers, self._messages(now_ns()), strict=True):
                publisher.put(message)

    def _messages(self, stamp):
        state = State(
            stamp=stamp, name=StateName.REPEAT_FOLLOW, environment="garden", since=stamp - 75_000_000_000,
            reason="a route of 72.0 m", waiting_for="light", goal="gate", goals=[Goal(to="shed")], route="x",
        )  # fmt: skip
        reasons = [StopReason(rule="metres_unlocalized", text="3.4 m without a localization")]
        place = Localization(
            stamp=stamp, route="x", trunk=VERTEX, trunk_index=12, T_trunk_robot=np.eye(4), covariance=np.eye(6),
            success=False, stream="plain", inliers=12, metres_since_success=3.4, seconds_since_success=3.1,
        )  # fmt: skip
        path = TrackerStatus(
            stamp=stamp, route="x", lateral_error=0.012, heading_error=0.01, arclength=30, remaining=42,
            speed_limit=1.2, finished=False,
        )  # fmt: skip
        return state, SafetyStatus(stamp=stamp, passing=True, scale=0.5, latched=False, reasons=reasons), place, path


def test_watching_shows_all_of_it_in_80_columns_survives_the_router_and_ends_on_ctrl_c(robot):
    with Terminal("state", "--watch", "-c", robot.config) as terminal:
        screen = terminal.shows(
            "Repeat.Follow", "for 1 min 15 s", "a route of 72.0 m", "light", "gate, then shed", "slowed to 50 %",
            "3.4 m without", "dead reckoning", "+1.2 cm beside", "42.0 m to go", "missing, and needed", "present",
        )  # fmt: skip
        assert max(len(line.rstrip("\r\n")) for line in screen.splitlines()) <= 80
        robot.kill("router")
        terminal.shows("no router", "safety", "silent", "unknown")
        robot.start_router()
        terminal.shows("for 1 min 15 s", "slowed to 50 %", "navigator", "present")
        terminal.type("\x03")
        assert terminal.ends() == 0
        assert "\x1b[?1049l" in terminal.raw, "the terminal is given back"
        assert "Traceback" not in terminal.raw


def test_colours_are_for_terminals_and_not_where_nobody_wants_them(robot):
    coloured = "\x1b[33m"
    with Terminal("state", "--watch", "-c", robot.config) as terminal:
        terminal.shows("slowed to 50 %")
        assert coloured in terminal.raw
    with Terminal("state", "--watch", "-c", robot.config, NO_COLOR="1") as terminal:
        terminal.shows("slowed to 50 %")
        assert coloured not in terminal.raw
        os.kill(terminal.pid, signal.SIGTERM)
        assert terminal.ends() == 0
        assert "\x1b[?1049l" in terminal.raw, "the terminal is given back"


def test_watching_into_a_pipe_prints_changes_as_lines(robot):
    watching = subprocess.Popen(
        [sys.executable, "-m", "cli", "state", "--watch", "--json", "-c", str(robot.config)],
        stdout=subprocess.PIPE, text=True, cwd=ROOT,
    )  # fmt: skip
    with watching:
        assert json.loads(watching.stdout.readline())["state"]["goal"] == "gate"
        watching.kill()


def test_keys_drive_while_they_are_held_and_the_robot_stops_behind_them(robot):
    commands = robot.bus("safety-watch").subscribe(topics.TELEOP)
    with Terminal("drive", "--speed", "0.6", "-c", robot.config) as terminal:
        terminal.shows("q end")
        terminal.hold("w", 0.5)
        assert eventually(lambda: (last := commands.last()) and last.message.v == 0.6, "it drives ahead")
        terminal.type("\x1b[D")
        assert eventually(lambda: (m := commands.last().message).v == 0.6 and m.w == 0.5, "it turns left, driving on")
        assert eventually(lambda: commands.last().message.v == 0.0, "it stops by itself", HELD_S + 2.0)
        terminal.type("q")
        assert terminal.ends() == 0
    assert "commanded" in terminal.raw


def test_driving_needs_a_terminal(vtr):
    result = vtr("drive")
    assert result.code == 1
    assert "terminal" in result.sentence


def test_a_key_pressed_after_a_rest_starts_anew():
    keys = Keys(speed=1.0, turn_rate=0.5)
    keys.press("w", 10.0)
    keys.press("x", 10.1)
    assert keys.command(10.0 + HELD_S) == (1.0, 0.0)
    assert keys.command(10.0 + HELD_S + 0.01) == (0.0, 0.0)
    keys.press("d", 20.0)
    assert keys.command(20.0) == (0.0, -0.5)
    keys.press("s", 20.1)
    keys.press("a", 20.2)
    assert keys.command(20.3) == (-1.0, 0.5)
    keys.press(" ", 20.4)
    assert keys.command(20.4) == (0.0, 0.0)


def completed(shell, words, robot=None):
    """What a shell is offered for a command line."""
    count = len(words.split(" ")) - 1
    environment = {
        **os.environ, "PYTHONPATH": str(ROOT), "_VTR_COMPLETE": f"complete_{shell}",
        "COMP_WORDS": words, "COMP_CWORD": str(count), "_TYPER_COMPLETE_ARGS": words,
        "_TYPER_COMPLETE_FISH_ACTION": "get-args",
    }  # fmt: skip
    if robot is not None:
        environment["VTR_CONFIG"] = str(robot.config)
    done = subprocess.run(
        [sys.executable, "-m", "cli"], env=environment, capture_output=True, text=True, check=False, timeout=20
    )
    assert done.stderr == ""
    return done.stdout


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_shells_complete_commands_and_options(shell):
    assert "calibrate" in completed(shell, "vtr cal")
    assert "--watch" in completed(shell, "vtr state --wa")


def test_a_shell_completes_the_robots_own_places_and_maps(robot):
    assert completed("bash", "vtr repeat ga", robot).split() == ["gate"]
    assert completed("bash", "vtr maps show 1", robot).split() == [VERTEX.map_id]
    assert completed("bash", "vtr repeat gate --mode ex", robot).split() == ["explore"]


def test_without_a_robot_nothing_is_completed_and_nothing_is_said(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("VTR_CONFIG", raising=False)
    assert completed("bash", "vtr repeat ga").strip() == ""


def test_bash_itself_completes(tmp_path):
    vtr = tmp_path / "vtr"
    vtr.write_text(f'#!/bin/sh\nPYTHONPATH={ROOT} exec {sys.executable} -m cli "$@"\n')
    vtr.chmod(0o755)
    script = (
        'eval "$(vtr --show-completion)"; COMP_WORDS=(vtr maps lim); COMP_CWORD=2;'
        ' _vtr_completion vtr; echo "${COMPREPLY[@]}"'
    )
    environment = {**os.environ, "PATH": f"{tmp_path}:{os.environ['PATH']}"}
    done = subprocess.run(["bash", "-c", script], env=environment, capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "limit"
